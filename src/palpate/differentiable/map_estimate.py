"""The maximum-a-posteriori volume as a function of the counts, and its derivative at the optimum, in NumPy."""

import warnings

import numpy as np

from palpate.arrays import ArrayLike, Float32, float32
from palpate.errors import DataError
from palpate.reconstruction.laplace_approximation import solve_hessian
from palpate.reconstruction.models.likelihood import Transmission, WeightedLeastSquares
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.optimizers.problem import Problem
from palpate.reconstruction.prior_parameters import median_curvature
from palpate.reconstruction.projector import Projector
from palpate.scans.scan import Scan

SETTLED = 1e-6  # largest change of a voxel in an iteration at which it ends, of the largest value
MOST = 3000  # of its iterations


class MapEstimate:
    """f̂(y), the minimum over f ≥ 0 of h(A f; y) + β R(f) for Poisson counts y and a quadratic prior, and its derivative.

    Where f̂ > 0 the objective's gradient is 0. Its total derivative by y is 0 too: H ∂f̂/∂y = −Aᵀ ∂h'/∂y, with
    H = Aᵀ h'' A + β K among those voxels. So vᵀ ∂f̂/∂y = −(∂h'/∂y) A w with H w = v, which conjugate gradients solve.

    Parameters
    ----------
    A : Projector
        The projector of the scan's views.
    scan : Scan
        Its incident beam, background and mask count. Its counts give β = strength × the median of the data's curvature,
        which stays as it is for other counts.
    strength : float
        Strength of the quadratic prior, as in `pp.Prior`.

    Raises
    ------
    DataError
        If the strength is not above 0, or the scan is not of the projector's views or has blur.

    References
    ----------
    Implicit differentiation of an optimum: Blondel et al., NeurIPS 2022. Of a penalized-likelihood image: Fessler, IEEE
    Trans. Image Process. 5:493, 1996.

    Examples
    --------
    >>> estimate = MapEstimate(pp.Projector(views, grid), scan, strength=1.0)
    >>> f = estimate.volume(scan.counts)
    >>> by_counts = estimate.gradient(scan.counts, f, np.ones(grid.shape))
    >>> bool(by_counts.sum() < 0)  # more photons arrive through less tissue
    True
    """

    def __init__(self, A: Projector, scan: Scan, strength: float) -> None:
        if not (np.isfinite(strength) and strength > 0):
            raise DataError(f"strength: {strength!r}; give a number above 0, such as 1")
        if scan.blur is not None:
            raise DataError("blur: not in this estimate, whose derivative takes pixels one by one; leave the blur out")
        if scan.shape != A.range_shape:
            raise DataError(
                f"scan: shape {scan.shape}, but the projector gives {A.range_shape}; take the scan's own views"
            )
        self.A, self.scan, self.prior = A, scan, Prior("quadratic", strength=strength)
        self.beta = strength * median_curvature(data_curvature(A, Transmission.of(scan)))

    def volume(self, counts: ArrayLike) -> Float32:
        """Return the estimate.

        Parameters
        ----------
        counts : array_like, (views, rows, columns)
            Photons.

        Returns
        -------
        ndarray, (z, y, x)
            Attenuation, 1/mm, float32.

        Raises
        ------
        DataError
            If counts are negative, not finite, or of another shape.
        """
        _, data = self._problem(counts)
        chord = self.A(np.ones(self.A.domain_shape, np.float32)) * data.measured
        level = max(float(np.vdot(chord, data.line_integrals) / np.vdot(chord, chord)), 0.0)
        f = np.full(self.A.domain_shape, level, np.float32)  # of a uniform body
        run = memory_gradient(self.A, data, self.prior, self.beta, f)
        for _ in range(MOST):
            before, (f, _objective) = f, next(run)
            if np.abs(f - before).max() <= SETTLED * f.max():
                return np.array(f)
        warnings.warn(
            f"the MAP estimate still moves after {MOST} iterations; its gradient may be inexact", stacklevel=2
        )
        return np.array(f)

    def gradient(self, counts: ArrayLike, estimate: ArrayLike, cotangent: ArrayLike) -> Float32:
        """Return the derivative of Σ cotangent · f̂ by the counts.

        Parameters
        ----------
        counts : array_like, (views, rows, columns)
            Photons.
        estimate : array_like, (z, y, x)
            What `volume` gave for them, 1/mm.
        cotangent : array_like, (z, y, x)
            Weight of each voxel.

        Returns
        -------
        ndarray, (views, rows, columns)
            1/mm a photon, times the weight; 0 where nothing was measured.

        Raises
        ------
        DataError
            If an array has the wrong shape, or the Hessian cannot be solved.
        """
        problem, data = self._problem(counts)
        f = float32("estimate", estimate, self.A.domain_shape)
        primary = data.incident * np.exp(-self.A(f))
        mean = np.where(primary > 0, primary + data.background, np.float32(1))
        # h'' = b e⁻ˡ (1 − y r / m²), cut at 0 as the posterior's is: with less the system need not be positive definite.
        curvature = primary * (1 - data.counts * data.background / np.square(mean))
        v = float32("cotangent", cotangent, self.A.domain_shape)
        quadratic = WeightedLeastSquares(np.zeros_like(curvature), np.maximum(curvature, 0))
        w = solve_hessian(problem, quadratic, f > 0, v)
        return np.asarray(-primary / mean * self.A(w), np.float32)

    def _problem(self, counts: ArrayLike) -> tuple[Problem, Transmission]:
        y = float32("counts", counts, self.scan.shape)
        scan = Scan(y, self.scan.incident, self.scan.views, self.scan.background, self.scan.mask)
        data = Transmission.of(scan)
        return Problem(self.A, data, self.prior, self.beta, "precomputed"), data
