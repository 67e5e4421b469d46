"""The code of docs/tensors.md runs as it stands."""

import re
from pathlib import Path

import numpy as np
from support.jax_here import required_jax

ROOT = Path(__file__).parents[2]


def blocks(page):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / "docs" / page).read_text(), re.MULTILINE | re.DOTALL)


def test_the_page_on_tensors_runs():
    jax = required_jax()
    names = {}
    exec("\n".join(blocks("reference/index.md")), names)
    before = jax.config.jax_enable_x64
    try:
        exec("\n".join(blocks("tensors.md")), names)
    finally:
        jax.config.update("jax_enable_x64", before)
    np.testing.assert_array_equal(names["q"], names["p"])
    first, _ = names["loss"](0 * names["x"])
    assert float(names["now"]) < float(first)
    assert float(names["by_counts"].sum()) < 0
    assert names["stiffness"].shape == (3, 3)
    assert float(names["stiffness"][2, 2]) < 0
    assert (np.asarray(names["by_young"]) > 0).all()
