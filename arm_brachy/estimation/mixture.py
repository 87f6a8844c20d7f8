"""A state with several Gaussian priors, one for each suspicion, weighed by what each predicted.

Multiple-model estimation: every hypothesis is a Gaussian, conditioned on the same measurement in
closed form; its weight is its prior weight times the likelihood of what was measured. The mean and
covariance of the whole are those of the mixture, so that hypotheses that disagree widen it.
Source: Magill 1965, IEEE Trans Autom Control 10:434; Bar-Shalom, Li & Kirubarajan 2001, sec. 11.6.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from arm_brachy.core.errors import NotConverged

FORGOTTEN = 1e-9   # of the variance known from before, below which it is dropped


@dataclass(frozen=True)
class Mixture:
    """h Gaussians over a state of s numbers.

    scale : (h, s) sd of the priors, independent numbers of mean zero
    mean : (h, s);  known : (h, s, r), covariance = diag(scale^2) - known known'
    log_weight : (h,), exponentials sum to one
    Test: estimation/test_mixture.py
    """

    scale: np.ndarray
    mean: np.ndarray
    known: np.ndarray
    log_weight: np.ndarray

    @classmethod
    def prior(cls, scale):
        """The priors, equally likely. scale : (h, s)."""
        h, s = scale.shape
        return cls(scale, np.zeros((h, s)), np.zeros((h, s, 0)), np.full(h, -np.log(h)))

    def forgotten(self, rho):
        """The mixture after forgetting: state times rho, the rest of the prior's variance anew.

        rho : 0 to 1. An Ornstein-Uhlenbeck walk whose stationary state is the prior; the weights'
        logarithms shrink by rho likewise.
        """
        known = rho * self.known if rho**2 > FORGOTTEN else self.known[:, :, :0]
        weight = rho * self.log_weight
        return Mixture(self.scale, rho * self.mean, known, weight - logsumexp(weight))

    @property
    def weights(self):
        """(h,) probabilities."""
        return np.exp(self.log_weight)

    def average(self):
        """(s,) mean of the whole."""
        return self.weights @ self.mean

    def covariance(self, B):
        """(n, n) covariance of B state, B (n, s): within the hypotheses and between them."""
        seen = B @ self.known
        within = (B * self.scale[:, None]**2) @ B.T - seen @ np.swapaxes(seen, 1, 2)
        apart = (self.mean - self.average()) @ B.T
        return np.einsum('h,hij->ij', self.weights, within) + (self.weights * apart.T) @ apart

    def measured(self, H):
        """What a measurement H state (m,) has to do with the state; see Measured."""
        cross = self.scale[:, :, None]**2 * H.T - self.known @ (
            np.swapaxes(self.known, 1, 2) @ H.T)
        return Measured(self, H, cross, H @ cross)


@dataclass(frozen=True)
class Measured:
    """A Mixture and a measurement, before its noise and value are known.

    cross : (h, s, m) covariance of state and measurement;  own : (h, m, m) of the measurement
    """

    mixture: Mixture
    H: np.ndarray
    cross: np.ndarray
    own: np.ndarray

    def conditioned(self, z, noise, trust):
        """The Mixture once z (m,) is measured with noise (m,), variances.

        trust : power of the likelihood in the weights; 1 where the model is the truth, less where
            rows of z err together in ways that noise does not tell
        Raises NotConverged where a covariance of the measurement is not positive definite.
        """
        before, root = self.mixture, self._root(noise)
        white = np.linalg.solve(root, np.concatenate(
            [self._innovation(z), np.swapaxes(self.cross, 1, 2)], axis=2))
        gain, r = np.swapaxes(white[:, :, 1:], 1, 2), white[:, :, 0]
        return Mixture(before.scale, before.mean + np.einsum('hsm,hm->hs', gain, r),
                       _compressed(np.concatenate([before.known, gain], axis=2)),
                       self._weighed(root, r, trust))

    def average(self, z, noise, trust):
        """(s,) mean of `conditioned`, for a fraction of the work; arguments as there."""
        root = self._root(noise)
        r = np.linalg.solve(root, self._innovation(z))
        back = np.linalg.solve(np.swapaxes(root, 1, 2), r)
        mean = self.mixture.mean + (self.cross @ back)[:, :, 0]
        return np.exp(self._weighed(root, r[:, :, 0], trust)) @ mean

    def _root(self, noise):
        S = self.own + noise * np.eye(len(noise))
        try:
            return np.linalg.cholesky(0.5 * (S + np.swapaxes(S, 1, 2)))
        except np.linalg.LinAlgError:
            raise NotConverged('gaussian update: covariance of the measurement is not positive; '
                               'give every measurement some noise') from None

    def _innovation(self, z):
        return (z - self.mixture.mean @ self.H.T)[:, :, None]

    def _weighed(self, root, r, trust):
        """(h,) log weights after the whitened innovation r (h, m)."""
        log = -0.5 * (r**2).sum(axis=1) - np.log(
            np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        weight = self.mixture.log_weight + trust * log
        return weight - logsumexp(weight)


def _compressed(known):
    """known with as many columns as the state has numbers at most, known known' unchanged."""
    if known.shape[2] <= known.shape[1]:
        return known
    return np.swapaxes(np.linalg.qr(np.swapaxes(known, 1, 2), mode='r'), 1, 2)
