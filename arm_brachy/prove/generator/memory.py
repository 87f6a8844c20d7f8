"""Forces of tissue that remembers: relaxing branches, and softening by past strain.

Softening takes the share damage(x) of the modulus, x the largest energy so far over a scale: with
D the most it takes, D (1 - exp(-x)) as the registry has it, or else as RATIONAL and
FROM_A_THRESHOLD say.
"""
from dataclasses import dataclass

import numpy as np
from numba import njit

from arm_brachy.prove.generator.assembly import deformation
from arm_brachy.prove.generator.law import cofactor, stress

# How damage grows: with 1 - exp(-x); with x / (1 + x); not below x = 1/3, then by the first.
SATURATING, RATIONAL, FROM_A_THRESHOLD = range(3)
THRESHOLD = 1.0 / 3.0


@njit(cache=True)
def lost(x, kind):
    """Share of all damage that there is at energy x over its scale, and its derivative by x."""
    if kind == RATIONAL:
        return x / (1 + x), 1 / (1 + x)**2
    if kind == FROM_A_THRESHOLD:
        if x < THRESHOLD:
            return 0.0, 0.0
        x = x - THRESHOLD
    return 1 - np.exp(-x), np.exp(-x)


@dataclass(frozen=True)
class Law:
    """shares (b,) of the instantaneous modulus that relax, times (b,) [s]; damage: largest share
    that can be lost; energy [Pa]: the scale of damage; softening: how that grows.
    """

    shares: tuple = (0.0, 0.0)
    times: tuple = (1.0, 1.0)
    damage: float = 0.0
    energy: float = 1.0
    softening: int = SATURATING

    @property
    def gains(self):
        """Modulus of each branch over the lasting one (b,)."""
        g = np.array(self.shares)
        return g / (1 - g.sum())

    def steps(self, dt):
        """Decay (b,) of the branches over dt [s], and what they gain (b,) of a step of stress."""
        tau = np.array(self.times)
        decay = np.exp(-dt / tau)
        return decay, self.gains * (1 - decay) * tau / dt

    def kept(self, memory):
        """Share (m, q) of the modulus that softening has left."""
        return 1 - self.damage * _losses(memory.energy / self.energy, self.softening)[0]

    def sudden(self, memory, dt):
        """Shear modulus (m, q) of a small step in dt [s], over that of fresh tissue at length."""
        return self.kept(memory) * (1 + self.steps(dt)[1].sum())

    def loss(self, before, after):
        """Share (m, q) of the modulus that softening takes per energy [1/Pa], where it grows."""
        rate = self.damage / self.energy * _losses(after.energy / self.energy, self.softening)[1]
        return np.where(after.energy > before.energy, rate, 0.0)

    def standing(self, memory, dt):
        """Stress (m, q, 3, 3) [Pa] left of the past at the end of a step dt [s] to `memory`."""
        past = memory.branches.sum(0) - self.steps(dt)[1].sum() * memory.stress
        return self.kept(memory)[..., None, None] * past


@njit(cache=True)
def _losses(x, kind):
    """`lost` of every entry of x (m, q), both (m, q)."""
    share, rate = np.empty(x.shape), np.empty(x.shape)
    for e in range(x.shape[0]):
        for q in range(x.shape[1]):
            share[e, q], rate[e, q] = lost(x[e, q], kind)
    return share, rate


@dataclass
class Memory:
    """What the tissue remembers at its integration points (m, q): stress (m, q, 3, 3) of the
    lasting law (second Piola-Kirchhoff, isochoric) at the last step, that of the branches
    (b, m, q, 3, 3) [Pa], and the largest energy so far (m, q) [Pa].
    """

    stress: np.ndarray
    branches: np.ndarray
    energy: np.ndarray

    @classmethod
    def fresh(cls, shape, branches=2):
        """Memory of tissue that has never been strained; shape (m, q)."""
        return cls(np.zeros((*shape, 3, 3)), np.zeros((branches, *shape, 3, 3)), np.zeros(shape))


@njit(cache=True)
def remembered(u, tets, dn, vol, mu, c, d, k, a, old, branches, past, decay, step, damage,
               energy, softening, new, grown, most):
    """Nodal forces (n, 3) [N] that memory adds to those of the lasting law.

    old, branches, past : the `Memory` before the step; decay (b,) exp(-dt/tau), step (b,) gain
    times (1 - decay) tau / dt: exact for stress linear in time.  new, grown, most : the memory
    after it, filled in.  Softening takes its share of the branches as well.
    """
    f = np.zeros(u.shape)
    for e in range(tets.shape[0]):
        for q in range(vol.shape[1]):
            F = deformation(u, tets[e], dn[e, q])
            J, C = cofactor(F)
            P = stress(F, J, C, mu[e, q], c[e, q], d[e, q], k[e, q], a[e, q])
            S = C.T @ P / J
            off = J ** (-2.0 / 3.0) * (F * F).sum() - 3
            most[e, q] = max(past[e, q], mu[e, q] / 2 * off + c[e, q] * off**2 + d[e, q] * off**3)
            kept = 1 - damage * lost(most[e, q] / energy, softening)[0]
            T = np.zeros((3, 3))
            for b in range(decay.shape[0]):
                for i in range(3):
                    for j in range(3):
                        h = decay[b] * branches[b, e, q, i, j] + step[b] * (
                            S[i, j] - old[e, q, i, j])
                        grown[b, e, q, i, j] = h
                        T[i, j] += kept * h
            for i in range(3):
                for j in range(3):
                    new[e, q, i, j] = S[i, j]
                    T[i, j] += (kept - 1) * S[i, j]
            X = F @ T
            for n in range(tets.shape[1]):
                for i in range(3):
                    f[tets[e, n], i] += vol[e, q] * (X[i, 0] * dn[e, q, n, 0]
                                                     + X[i, 1] * dn[e, q, n, 1]
                                                     + X[i, 2] * dn[e, q, n, 2])
    return f


@njit(cache=True)
def prestress(H, tets, dn, vol, where, data):
    """Add to `data` the stiffness of standing second Piola-Kirchhoff stress H (m, q, 3, 3)."""
    for e in range(tets.shape[0]):
        for q in range(vol.shape[1]):
            for n in range(tets.shape[1]):
                h = vol[e, q] * (H[e, q] @ dn[e, q, n])
                for o in range(tets.shape[1]):
                    k = (h * dn[e, q, o]).sum()
                    for i in range(3):
                        at = where[e, 3 * n + i, 3 * o + i]
                        if at >= 0:
                            data[at] += k


@njit(cache=True)
def soften(u, tets, dn, vol, mu, c, d, loss, where, data):
    """Take from `data` what softening that grows takes of the stiffness at displacement u.

    mu, c, d : of the energy that softens;  loss : (m, q) [1/Pa], see `Law.loss`
    """
    plain = np.zeros(3)
    for e in range(tets.shape[0]):
        for q in range(vol.shape[1]):
            if loss[e, q] == 0.0:
                continue
            F = deformation(u, tets[e], dn[e, q])
            J, C = cofactor(F)
            pull = dn[e, q] @ stress(F, J, C, mu[e, q], c[e, q], d[e, q], 0.0, plain).T
            for n in range(tets.shape[1]):
                for o in range(tets.shape[1]):
                    for i in range(3):
                        for j in range(3):
                            at = where[e, 3 * n + i, 3 * o + j]
                            if at >= 0:
                                data[at] -= vol[e, q] * loss[e, q] * pull[n, i] * pull[o, j]


def advance(model, law, memory, u, dt):
    """Forces (n, 3) that memory adds at displacement u, dt [s] after `memory`, and what it is."""
    decay, step = law.steps(dt)
    after = Memory(np.empty_like(memory.stress), np.empty_like(memory.branches),
                   np.empty_like(memory.energy))
    dn, vol = model.grid.slopes
    tissue = model.tissue
    f = remembered(u, model.grid.mesh.tets, dn, vol, tissue.mu, tissue.stiffening, tissue.cubic,
                   tissue.fibre_modulus, tissue.fibre, memory.stress, memory.branches,
                   memory.energy, decay, step, law.damage, law.energy, law.softening,
                   after.stress, after.branches, after.energy)
    return f, after
