"""Threads of a process that computes runs; apart from the pool so that it can be read before numpy is."""

from __future__ import annotations

__all__ = ["THREAD_LIMITS"]

#: One thread each: workers share the processors already, and BLAS with another number of threads may
#: round otherwise. The libraries read these when they are first imported.
THREAD_LIMITS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "BLIS_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
