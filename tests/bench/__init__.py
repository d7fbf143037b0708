"""The blind bench: sessions with a hidden truth, the program's answers, and their rates."""
