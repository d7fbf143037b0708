"""One document per kind of result, as plain values, too; and what several of them show."""
