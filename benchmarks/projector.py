"""Time of a projection and a backprojection: `python benchmarks/projector.py`.

W1: 8 sources on a circle over a fixed panel. W2: 15 sources on an arc over a breast panel. W4: 11 views of a
head by a panel that turns with the source.
"""

import time

import numpy as np

import palpate as pp


def circular() -> tuple[pp.Views, pp.Grid]:
    a = np.arange(8) * np.pi / 4
    source = np.stack([250 * np.cos(a), 250 * np.sin(a), 0 * a + 1000], axis=1)
    panel = pp.Panel((512, 512), (0.4, 0.4), (-102.2, -102.2, 0))
    return pp.Views(source, panel), pp.Grid((48, 256, 256), (1, 0.5, 0.5), (-63.75, -63.75, 30.5))


def arc() -> tuple[pp.Views, pp.Grid]:
    a = np.radians(np.linspace(-25, 25, 15))
    source = np.stack([650 * np.sin(a), 0 * a, 40 + 650 * np.cos(a)], axis=1)
    panel = pp.Panel((768, 1024), (0.17, 0.17), (-86.955, 0.085, 0))
    return pp.Views(source, panel), pp.Grid((50, 512, 800), (1, 0.2, 0.2), (-79.9, 0.1, 30.5))


def turning() -> tuple[pp.Views, pp.Grid]:
    a = np.radians(np.arange(-20, 21, 4))
    source = np.stack([1000 * np.sin(a), 0 * a, 1000 * np.cos(a)], axis=1)
    panels = []
    for s, t in zip(source, a, strict=True):
        column_axis = np.array([np.cos(t), 0, -np.sin(t)])
        corner = -s / 2 - 255.5 * 0.78125 * (column_axis + [0, 1, 0])
        panels.append(pp.Panel((512, 512), (0.78125, 0.78125), corner, (0, 1, 0), column_axis))
    return pp.Views(source, panels), pp.Grid((50, 300, 300), (5, 1, 1), (-149.5, -149.5, -122.5))


def best(work, repeats: int = 5) -> tuple[float, float]:
    """Least wall and CPU seconds of several runs, after one to warm up."""
    work()
    wall, cpu = [], []
    for _ in range(repeats):
        start = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - start[0])
        cpu.append(time.process_time() - start[1])
    return min(wall), min(cpu)


def main() -> None:
    print("               products     forward wall/CPU s   back wall/CPU s   giga voxel-views/CPU-s")
    for name, make in (("W1 circular-8", circular), ("W2 dbt-15", arc), ("W4 turning-11", turning)):
        views, grid = make()
        A = pp.Projector(views, grid)
        x = np.random.default_rng(0).random(grid.shape, dtype=np.float32)
        p = A(x)
        forward, back = best(lambda: A(x, out=p)), best(lambda: A.T(p, out=x))  # noqa: B023
        products = [A.geometry.products(view) for view in range(len(views))]
        rate = grid.size * len(views) / forward[1] / 1e9
        print(
            f"{name:14} {min(products):5}-{max(products):<5} {forward[0]:9.3f} {forward[1]:9.3f} {back[0]:9.3f} {back[1]:9.3f}"
            f" {rate:9.2f}"
        )


if __name__ == "__main__":
    main()
