"""One document per kind of result; each module makes one and says it as plain values, too."""
