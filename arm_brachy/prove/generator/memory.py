"""Forces of tissue that remembers: two relaxing branches, and softening by past strain."""
from dataclasses import dataclass

import numpy as np
from numba import njit

from arm_brachy.prove.generator.assembly import deformation
from arm_brachy.prove.generator.law import cofactor, stress


@dataclass(frozen=True)
class Law:
    """shares (2,) of the instantaneous modulus that relax, times (2,) [s]; damage: largest share
    that can be lost, energy [Pa] at which 63 % of it is.
    """

    shares: tuple = (0.0, 0.0)
    times: tuple = (1.0, 1.0)
    damage: float = 0.0
    energy: float = 1.0

    @property
    def gains(self):
        """Modulus of each branch over the lasting one (2,)."""
        g = np.array(self.shares)
        return g / (1 - g.sum())

    def steps(self, dt):
        """Decay (2,) of the branches over dt [s], and what they gain (2,) of a step of stress."""
        tau = np.array(self.times)
        decay = np.exp(-dt / tau)
        return decay, self.gains * (1 - decay) * tau / dt

    def kept(self, memory):
        """Share (m, q) of the modulus that softening has left."""
        return 1 - self.damage * (1 - np.exp(-memory.energy / self.energy))

    def sudden(self, memory, dt):
        """Shear modulus (m, q) of a small step in dt [s], over that of fresh tissue at length."""
        return self.kept(memory) * (1 + self.steps(dt)[1].sum())

    def loss(self, before, after):
        """Share (m, q) of the modulus that softening takes per energy [1/Pa], where it grows."""
        rate = self.damage / self.energy * np.exp(-after.energy / self.energy)
        return np.where(after.energy > before.energy, rate, 0.0)

    def standing(self, memory, dt):
        """Stress (m, q, 3, 3) [Pa] left of the past at the end of a step dt [s] to `memory`."""
        past = memory.branches.sum(0) - self.steps(dt)[1].sum() * memory.stress
        return self.kept(memory)[..., None, None] * past


@dataclass
class Memory:
    """What the tissue remembers at its integration points (m, q): stress (m, q, 3, 3) of the
    lasting law (second Piola-Kirchhoff, isochoric) at the last step, that of both branches
    (2, m, q, 3, 3) [Pa], and the largest energy so far (m, q) [Pa].
    """

    stress: np.ndarray
    branches: np.ndarray
    energy: np.ndarray

    @classmethod
    def fresh(cls, shape):
        """Memory of tissue that has never been strained; shape (m, q)."""
        return cls(np.zeros((*shape, 3, 3)), np.zeros((2, *shape, 3, 3)), np.zeros(shape))


@njit(cache=True)
def remembered(u, tets, dn, vol, mu, kappa, c, k, a, old, branches, past, decay, step, damage,
               energy, new, grown, most):
    """Nodal forces (n, 3) [N] that memory adds to those of the lasting law.

    old, branches, past : the `Memory` before the step; decay (2,) exp(-dt/tau), step (2,) gain
    times (1 - decay) tau / dt: exact for stress linear in time.  new, grown, most : the memory
    after it, filled in.  Softening takes its share of the branches as well.
    """
    f = np.zeros(u.shape)
    for e in range(tets.shape[0]):
        for q in range(vol.shape[1]):
            F = deformation(u, tets[e], dn[e, q])
            J, C = cofactor(F)
            P = stress(F, J, C, mu[e, q], c[e, q], k[e, q], a)
            S = C.T @ P / J
            ib = J ** (-2.0 / 3.0) * (F * F).sum()
            most[e, q] = max(past[e, q], mu[e, q] / 2 * (ib - 3) + c[e, q] * (ib - 3) ** 2)
            kept = 1 - damage * (1 - np.exp(-most[e, q] / energy))
            T = np.zeros((3, 3))
            for b in range(2):
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
def soften(u, tets, dn, vol, mu, c, loss, where, data):
    """Take from `data` what softening that grows takes of the stiffness at displacement u.

    mu, c : of the energy that softens;  loss : (m, q) [1/Pa], see `Law.loss`
    """
    plain = np.zeros(3)
    for e in range(tets.shape[0]):
        for q in range(vol.shape[1]):
            if loss[e, q] == 0.0:
                continue
            F = deformation(u, tets[e], dn[e, q])
            J, C = cofactor(F)
            pull = dn[e, q] @ stress(F, J, C, mu[e, q], c[e, q], 0.0, plain).T
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
    f = remembered(u, model.grid.mesh.tets, dn, vol, tissue.mu, tissue.kappa, tissue.stiffening,
                   tissue.fibre_modulus, tissue.fibre, memory.stress, memory.branches,
                   memory.energy, decay, step, law.damage, law.energy, after.stress,
                   after.branches, after.energy)
    return f, after
