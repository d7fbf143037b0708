"""The blind bench: sessions with a hidden truth, the program's answers, and their rates."""

# For libraries that start threads of their own: ratios are of one, and processes share the cores.
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
