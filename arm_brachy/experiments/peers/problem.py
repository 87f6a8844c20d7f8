"""The push that every solver is given, and what it hands back, as files that any of them reads."""

from dataclasses import asdict, dataclass

import numpy as np

from arm_brachy.tissue.element import SPREAD


@dataclass(frozen=True)
class Rule:
    """How a share of the energy is integrated over each element.

    degree : of polynomials that come out exact: 1 the centre alone, 2 four points
    mu, kappa : moduli [Pa] of that share
    """

    degree: int
    mu: float
    kappa: float


@dataclass(frozen=True)
class Problem:
    """A body with fixed nodes, and a bonded pad displaced from rest. SI.

    nodes : (n, 3) at rest;  elements : (m, 4) linear or (m, 10) quadratic tetrahedra, corners then
        the middles of the edges 01, 02, 03, 12, 13, 23
    fixed, pad : node indices, held at rest and displaced by `push` (3,)
    E, nu : Young's modulus [Pa] and Poisson's ratio of the Neo-Hookean energy (3.18)
    """

    nodes: np.ndarray
    elements: np.ndarray
    fixed: np.ndarray
    pad: np.ndarray
    push: np.ndarray
    E: float
    nu: float

    @property
    def mu(self):
        """Shear modulus [Pa]."""
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def kappa(self):
        """Bulk modulus [Pa]."""
        return self.E / (3.0 * (1.0 - 2.0 * self.nu))

    @property
    def quadratic(self):
        """True if the elements have mid-edge nodes."""
        return self.elements.shape[1] == 10

    @property
    def rules(self):
        """The Rules whose shares add up to the energy to be solved for; as `tissue.element`."""
        if not self.quadratic:
            return (Rule(1, self.mu, self.kappa),)
        spread = min(self.kappa, SPREAD * self.mu)
        everywhere = Rule(2, self.mu, spread)
        if spread == self.kappa:
            return (everywhere,)
        return everywhere, Rule(1, 0.0, self.kappa - spread)

    @property
    def held(self):
        """(k,) nodes with prescribed positions, ascending."""
        return np.union1d(self.fixed, self.pad)

    def way(self, share=1.0):
        """(n, 3) [m] prescribed displacements at this share of the push; rows of `held` count."""
        way = np.zeros_like(self.nodes)
        way[self.pad] = share * self.push
        return way

    def save(self, path):
        """Write to `path` (.npz)."""
        np.savez(path, **asdict(self))

    @classmethod
    def load(cls, path):
        """Read what `save` wrote."""
        with np.load(path) as file:
            return cls(**{name: file[name] if file[name].ndim else float(file[name])
                          for name in file.files})


@dataclass(frozen=True)
class Answer:
    """What a solver says of a Problem.

    x : (n, 3) [m] of the timed solve;  tight : (n, 3) [m] converged far below the tolerance
    pad_force : (3,) [N] of the tissue ON the pad, at `tight`
    cpu, wall : [s] of the cheapest timed solve, all threads of the process together
    iterations, load_steps : of that solve
    memory : [B] peak resident memory of the whole process, libraries and all
    version : of the package
    """

    x: np.ndarray
    tight: np.ndarray
    pad_force: np.ndarray
    cpu: float
    wall: float
    iterations: int
    load_steps: int
    memory: float
    version: str

    def save(self, path):
        """Write to `path` (.npz)."""
        np.savez(path, **asdict(self))

    @classmethod
    def load(cls, path):
        """Read what `save` wrote."""
        with np.load(path) as file:
            return cls(**{name: file[name] if file[name].ndim else file[name].item()
                          for name in file.files})
