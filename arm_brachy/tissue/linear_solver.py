"""Sparse direct solver: MKL PARDISO, analysed once per sparsity pattern, reproducible bit by bit.

pypardiso finds and loads the library; its solver class repeats the analysis for every matrix
and knows general matrices only, so the routine is called here with symmetric storage.
"""

import ctypes
import weakref

import numpy as np
from pypardiso import ps

from arm_brachy.core.errors import ArmBrachyError

_ANALYSE, _FACTOR, _SOLVE, _RELEASE = 11, 22, 33, -1
_POSITIVE_DEFINITE, _INDEFINITE = 2, -2
_ERRORS = {-1: 'inconsistent input', -2: 'out of memory', -3: 'reordering failed',
           -4: 'zero pivot or not positive definite', -7: 'singular diagonal'}
# mkl_service.h: MKL_THREADING_SEQUENTIAL, MKL_CBWR_AVX2, MKL_CBWR_COMPATIBLE. The last is the one
# every x86 processor has; the factorisation takes twice as long with it.
_SEQUENTIAL, _CBWR_AVX2, _CBWR_COMPATIBLE = 1, 10, 3

# Before the first computation, or MKL ignores it: one thread and one code path, so that the same
# matrix gives the same bits however many threads or which alignment the process happens to have.
ps.libmkl.MKL_Set_Threading_Layer(_SEQUENTIAL)
if ps.libmkl.MKL_CBWR_Set(_CBWR_AVX2):  # not zero: this processor has no AVX2
    ps.libmkl.MKL_CBWR_Set(_CBWR_COMPATIBLE)


# Right-hand sides: of 24 000 unknowns, 128 take a third less time each than 2000 at once.
AT_ONCE = 128


class FactorisationFailed(ArmBrachyError):
    """A matrix that cannot be factorised as claimed: singular, or not positive definite."""


class Pardiso:
    """Factorise symmetric matrices of one sparsity pattern and solve with them.

    indptr, indices : compressed rows of the upper triangle, diagonal included, columns sorted
    positive_definite : Cholesky, which refuses anything else; False takes L D L' with
        2 x 2 pivots for symmetric indefinite matrices
    single : keep the factor in single precision: half the time and memory; a solve is good to
        some 1e-5 of itself, which iterations mend that take their residual in double precision
    Not to be shared between threads. The factor is released when the object goes.
    """

    def __init__(self, indptr, indices, *, positive_definite=True, single=False):
        self.size = len(indptr) - 1
        _check_pattern(indptr, indices)
        self._mtype = _POSITIVE_DEFINITE if positive_definite else _INDEFINITE
        self._indptr = np.ascontiguousarray(indptr, dtype=np.int32)
        self._indices = np.ascontiguousarray(indices, dtype=np.int32)
        self._float = np.float32 if single else np.float64
        self._data = np.zeros(len(indices), self._float)
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = _parameters(positive_definite, single)
        self._factorised = False
        # A finaliser, not __del__: it also runs, in time, when the interpreter leaves.
        self._free = weakref.finalize(self, _release, self._handle, self._mtype, self._iparm)
        self._call(_ANALYSE)

    def factor(self, data):
        """Factorise the matrix whose upper triangle has entries `data` (nnz,), in pattern order.

        Raises FactorisationFailed; the object can then take another matrix.
        """
        self._data[:] = data
        self._factorised = False
        self._call(_FACTOR)
        self._factorised = True

    def solve(self, b):
        """Return A^-1 b for b (size,) or (size, k); `factor` must have succeeded before."""
        if not self._factorised:
            raise FactorisationFailed('solve called without a factor; call factor first')
        b = np.asarray(b)
        if b.shape[0] != self.size:
            raise ValueError(f'right-hand side has {b.shape[0]} rows; must be {self.size}')
        x = np.zeros(b.shape)
        if not b.size:
            return x
        columns, solved = (v.reshape(self.size, -1) for v in (b, x))
        for first in range(0, columns.shape[1], AT_ONCE):
            some = slice(first, first + AT_ONCE)
            right = np.array(columns[:, some], dtype=self._float, order='F')
            found = np.empty_like(right, order='F')
            self._call(_SOLVE, right, found)
            solved[:, some] = found
        return x

    @property
    def flops_per_entry(self):
        """Operations that a factorisation takes for each entry of the factor."""
        return 1e6 * self._iparm[18] / max(1, self._iparm[17])

    @property
    def factorised(self):
        """True if `solve` may be called."""
        return self._factorised

    @property
    def negative_eigenvalues(self):
        """Number of negative eigenvalues of the last indefinite matrix (Sylvester's law)."""
        return int(self._iparm[22])

    def _call(self, phase, b=None, x=None):
        if self.size:
            _pardiso(phase, self._handle, self._mtype, self._iparm, self._data, self._indptr,
                     self._indices, b, x)


def _release(handle, mtype, iparm):
    if handle.any():
        empty = np.zeros(1, dtype=np.int32)
        _pardiso(_RELEASE, handle, mtype, iparm, np.zeros(1), empty, empty, None, None)


def _pardiso(phase, handle, mtype, iparm, data, indptr, indices, b, x):
    """Call MKL's pardiso(); raise FactorisationFailed if it reports an error."""
    error = ctypes.c_int32(0)
    one, quiet = ctypes.c_int32(1), ctypes.c_int32(0)
    size = len(indptr) - 1
    columns = 1 if b is None or b.ndim == 1 else b.shape[1]
    ps.libmkl.pardiso(
        _pointer(handle, ctypes.c_int64), one, one, ctypes.c_int32(mtype), ctypes.c_int32(phase),
        ctypes.c_int32(size), _pointer(data, ctypes.c_double), _pointer(indptr, ctypes.c_int32),
        _pointer(indices, ctypes.c_int32), None, ctypes.c_int32(columns),
        _pointer(iparm, ctypes.c_int32), quiet, _pointer(b, ctypes.c_double),
        _pointer(x, ctypes.c_double), error)
    if error.value:
        reason = _ERRORS.get(error.value, 'internal error')
        raise FactorisationFailed(
            f'PARDISO error {error.value} ({reason}) for a matrix of {size} unknowns; check that '
            'the body is held and that the state is a stable equilibrium')


def _pointer(array, kind):
    """As MKL's wrapper declares it; values in single precision travel under double's name."""
    return None if array is None else array.ctypes.data_as(ctypes.POINTER(kind))


def _parameters(positive_definite, single):
    """PARDISO's iparm (0-based here), values from the oneMKL reference, table of iparm."""
    iparm = np.zeros(64, dtype=np.int32)
    iparm[0] = 1    # the values below, not the defaults
    iparm[1] = 2    # METIS nested dissection
    iparm[7] = 0    # no iterative refinement: the Newton iteration is the refinement
    iparm[9] = 8    # pivots below 1e-8 |A| are perturbed (indefinite matrices)
    iparm[17] = iparm[18] = -1  # the analysis reports entries of the factor and its Mflop
    iparm[27] = int(single)
    iparm[20] = 1   # 1 x 1 and 2 x 2 Bunch-Kaufman pivots (indefinite matrices)
    iparm[34] = 1   # indices count from 0
    return iparm


def _check_pattern(indptr, indices):
    rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    first = np.asarray(indices)[np.asarray(indptr[:-1])] if len(rows) else np.zeros(0)
    if len(first) != len(indptr) - 1 or np.any(first != np.arange(len(first))):
        raise ValueError('every row of the upper triangle must begin with its diagonal entry')
