"""Linear algebra without threads of its own."""

import os


def single_threaded() -> None:
    """Keeps BLAS from starting threads; to be called before numpy is imported.

    For matrices of some ten rows its threads only wait for each other: measured on two busy cores,
    a step with 17 rows took 11 ms instead of 0.2 ms, and one with 9 rows twice the CPU.
    """
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
