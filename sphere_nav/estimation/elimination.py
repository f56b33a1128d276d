"""Parameters that many images share: what each image has of its own is eliminated (Schur complement).

The covariance is that of a fit to clustered data: it comes from how differently the images pull, so that pixels of one
image may err together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sphere_nav.estimation.least_squares import clustered_covariance
from sphere_nav.geometry.arrays import Array

CORRELATED_PIXELS = 100.0  # that count as one against what is known beforehand; as in `photometric/align/esm.py`


@dataclass(frozen=True, eq=False)
class Part:
    """H (P + own, P + own) and g of one image by the inverse variance of its residuals, sigma in grey levels."""

    H: Array
    g: Array
    num_pixels: int
    sigma: float


class Elimination:
    """The normal equations of all parts, reduced to the P shared parameters.

    `prior_sigma` (P,) are the standard deviations known beforehand, `off` (P,) how far the state is from there.
    """

    def __init__(self, parts: Sequence[Part], prior_sigma: Array, off: Array) -> None:
        n = len(prior_sigma)
        own = len(parts[0].g) - n
        self._parts, self._n, self._off = parts, n, off
        self._inverse = [np.linalg.inv(part.H[n:, n:] + 1e-9 * np.eye(own)) for part in parts]
        self._gradients = np.empty((len(parts), n))
        self._H = np.zeros((n, n))
        for i, (part, inverse) in enumerate(zip(parts, self._inverse, strict=True)):
            cross = part.H[:n, n:] @ inverse
            self._H += part.H[:n, :n] - cross @ part.H[n:, :n]
            self._gradients[i] = part.g[:n] - cross @ part.g[n:]
        self._prior = np.diag(CORRELATED_PIXELS / prior_sigma**2)

    @property
    def num_pixels(self) -> int:
        """Residuals of all parts."""
        return sum(part.num_pixels for part in self._parts)

    @property
    def sigma(self) -> float:
        """Typical standard deviation of the residuals in grey levels: the median of the parts."""
        return float(np.median([part.sigma for part in self._parts]))

    def step(self) -> tuple[Array, list[Array], float]:
        """Return the steps of the shared (P,) and of each part's own parameters, and how large the shared one is.

        That is its largest share of the standard deviation which the pixels would leave were they independent but for
        CORRELATED_PIXELS.
        """
        n, H = self._n, self._H + self._prior
        shared = -np.linalg.solve(H, self._gradients.sum(axis=0) + self._prior @ self._off)
        own = [
            -inverse @ (part.g[n:] + part.H[n:, :n] @ shared)
            for part, inverse in zip(self._parts, self._inverse, strict=True)
        ]
        sigma = np.sqrt(np.diagonal(np.linalg.inv(H)) * CORRELATED_PIXELS)
        return shared, own, float(np.max(np.abs(shared) / sigma))

    def covariance(self, num_blocks: int = 0) -> Array:
        """Return the covariance (P, P) of clustered data, wider where little was known beforehand.

        A cluster is a part; or one of `num_blocks` runs of consecutive parts, where neighbours err alike. Each run then
        pulls by what it pulls above the mean of all.
        """
        inverse, gradients = np.linalg.inv(self._H + self._prior), self._gradients - self._gradients.mean(axis=0)
        run = np.arange(len(gradients))
        if 1 < num_blocks < len(gradients):
            run = np.sort(run % num_blocks)
        return clustered_covariance(inverse, gradients, run, known=self._prior * CORRELATED_PIXELS)
