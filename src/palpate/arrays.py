"""The array types of the public functions, and the one check that every array passes on its way in."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate import _core
from palpate.errors import DataError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:

    class ArrayLike:
        """What `numpy.asarray` takes, and arrays that other libraries export by DLPack from the CPU's memory.

        `help` shows this short name, not the union behind `numpy.typing.ArrayLike`.
        """


Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Complex128 = NDArray[np.complex128]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]
UInt8 = NDArray[np.uint8]
UInt16 = NDArray[np.uint16]
AnyArray = NDArray[Any]


CPU = 1  # DLPack's number
DEVICES = {
    2: "CUDA",
    3: "CUDA host",
    4: "OpenCL",
    7: "Vulkan",
    8: "Metal",
    10: "ROCm",
    13: "CUDA managed",
    14: "oneAPI",
}


def as_numpy(name: str, values: Any) -> AnyArray:
    """`values` as a NumPy array, without a copy if it is an array in the CPU's memory; other devices: a `DataError`."""
    if isinstance(values, np.ndarray) or not hasattr(values, "__dlpack__"):
        return np.asarray(values)
    try:
        kind, number = values.__dlpack_device__()
    except AttributeError:  # a tracer of JAX has the name alone; what NumPy meets there says what to do
        return np.asarray(values)
    if kind != CPU:
        device = DEVICES.get(int(kind), f"DLPack kind {int(kind)}")
        raise DataError(
            f"{name}: the array is on the device {device}:{number}, and palpate computes on the CPU; copy it there first, "
            f"as with x.cpu() in PyTorch or jax.device_put(x, jax.devices('cpu')[0]) in JAX"
        )
    try:
        return np.from_dlpack(values)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        raise DataError(
            f"{name}: {type(values).__name__} does not export its memory ({error}); detach it from its gradient, or convert "
            f"it to float32"
        ) from error


def float32(name: str, values: ArrayLike, shape: Sequence[int | None] | None = None) -> Float32:
    """`values` as a finite, C-contiguous float32 array of `shape` (None leaves an axis free), or a `DataError`."""
    array = _checked(name, values, shape)
    with np.errstate(over="ignore"):
        single = array.astype(np.float32, order="C", copy=False)
    if array.dtype == np.float64 and not _finite(single):
        raise DataError(f"{name}: {np.abs(array).max():g} is more than a float32 can hold; check the units")
    return single


def float64(name: str, values: ArrayLike, shape: Sequence[int | None] | None = None) -> Float64:
    """`values` as a finite, C-contiguous float64 array of `shape` (None leaves an axis free), or a `DataError`."""
    return _checked(name, values, shape).astype(np.float64, order="C", copy=False)


def _checked(name: str, values: ArrayLike, shape: Sequence[int | None] | None) -> AnyArray:
    array = as_numpy(name, values)
    if array.dtype.kind not in "fiub":
        raise DataError(f"{name}: expected real numbers, got dtype {array.dtype}; convert with .astype(float)")
    if shape is not None and (
        array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True))
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise DataError(f"{name}: expected shape {wanted}, got {array.shape}")
    if array.dtype.kind == "f" and not _finite(array):
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        bad = int(np.count_nonzero(~np.isfinite(array)))
        raise DataError(
            f"{name}: {bad} values are not finite (first at index {first}: {array[first]}); "
            f"mask or replace them, for example with numpy.nan_to_num"
        )
    return np.ascontiguousarray(array)


def _finite(array: AnyArray) -> bool:
    """Without a mask as large as the array, for the arrays that can be large."""
    if array.dtype == np.float32 and array.flags.c_contiguous:
        return _core.base.all_finite(array.reshape(-1))
    return bool(np.isfinite(array).all())
