"""A scan's projector as the linear physics of DeepInverse, so that its networks and algorithms can be trained on it."""

import math
from typing import Any

from palpate.differentiable.torch import Tensor, projection
from palpate.errors import ExtraError
from palpate.reconstruction.projector import LinearMap, Projector

try:
    import torch
    from deepinv.physics import LinearPhysics
except ModuleNotFoundError as error:
    raise ExtraError("DeepInverse is not installed: pip install 'palpate[deepinverse]'") from error


class ScanPhysics(LinearPhysics):  # type: ignore[misc]
    """Projections of volumes, (batch, channel, z, y, x) -> (batch, channel, views, rows, columns), on the CPU.

    Parameters
    ----------
    A : Projector
        The projector.
    **options
        Keywords of `deepinv.physics.LinearPhysics`, such as `noise_model`.

    References
    ----------
    Tachella et al., DeepInverse: a Python package for solving imaging inverse problems with deep learning, 2025.

    Examples
    --------
    >>> physics = ScanPhysics(pp.Projector(views, grid))
    >>> physics.A(torch.ones(1, 1, *grid.shape)).shape[2:] == views.shape
    True
    """

    def __init__(self, A: Projector, **options: Any) -> None:
        super().__init__(**options)
        self._projector = A

    def A(self, x: Tensor, **_: Any) -> Tensor:
        """Return the projections of each volume.

        Parameters
        ----------
        x : tensor, (batch, channel, z, y, x)
            The volumes.

        Returns
        -------
        tensor, (batch, channel, views, rows, columns)
            The projections.
        """
        return _each(self._projector, x)

    def A_adjoint(self, y: Tensor, **_: Any) -> Tensor:
        """Return the transpose of `A` of each set of projections.

        Parameters
        ----------
        y : tensor, (batch, channel, views, rows, columns)
            The projections.

        Returns
        -------
        tensor, (batch, channel, z, y, x)
            The volumes.
        """
        return _each(self._projector.T, y)


def _each(A: LinearMap, x: Tensor) -> Tensor:
    """A of the last three axes."""
    leading = tuple(x.shape[:-3])
    answers = [projection(A)(one) for one in x.reshape(math.prod(leading), *x.shape[-3:])]
    return torch.stack(answers).reshape(*leading, *A.range_shape)
