"""The local step (3.14) of points that carry volume change only, kappa / 2 (J - 1)^2.

`tissue.proximal` takes any Neo-Hookean point, but without shear modulus its Hessian is all but
singular beside the bulk modulus, and it needs tens of sweeps where this needs three or four.
"""

from numba import njit

MOST = 40   # sweeps; each leaves about r |J - 1| of the error before


@njit(cache=True, error_model='numpy')
def local_step(Y, z, u, ratio, tolerance):
    """z <- the minimiser of ratio / 2 (det z - 1)^2 + |z - Y|^2 / 2, u <- Y - z; returns sweeps.

    Y, z, u : (9, m), row by row, z and u written;  ratio : (m,) kappa V over the weight
    tolerance : last step, absolute
    Newton without the curvature of det, which along cof z is small beside ratio |cof z|^2 and
    across it is ratio |det z - 1| beside 1: it converges while that is below about 1 / 2.
    """
    worst = 0
    for e in range(Y.shape[1]):
        for sweep in range(MOST):
            c0 = z[4, e] * z[8, e] - z[5, e] * z[7, e]
            c1 = z[5, e] * z[6, e] - z[3, e] * z[8, e]
            c2 = z[3, e] * z[7, e] - z[4, e] * z[6, e]
            c3 = z[2, e] * z[7, e] - z[1, e] * z[8, e]
            c4 = z[0, e] * z[8, e] - z[2, e] * z[6, e]
            c5 = z[1, e] * z[6, e] - z[0, e] * z[7, e]
            c6 = z[1, e] * z[5, e] - z[2, e] * z[4, e]
            c7 = z[2, e] * z[3, e] - z[0, e] * z[5, e]
            c8 = z[0, e] * z[4, e] - z[1, e] * z[3, e]
            C = (c0, c1, c2, c3, c4, c5, c6, c7, c8)
            push = ratio[e] * (z[0, e] * c0 + z[1, e] * c1 + z[2, e] * c2 - 1.0)
            size, along = 0.0, 0.0
            for i in range(9):
                size += C[i] * C[i]
                along += C[i] * (z[i, e] - Y[i, e] + push * C[i])
            along *= ratio[e] / (1.0 + ratio[e] * size)
            largest = 0.0
            for i in range(9):
                step = Y[i, e] - z[i, e] - push * C[i] + along * C[i]
                z[i, e] += step
                largest = max(largest, abs(step))
            worst = max(worst, sweep + 1)
            if largest <= tolerance:
                break
        for i in range(9):
            u[i, e] = Y[i, e] - z[i, e]
    return worst
