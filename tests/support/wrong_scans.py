"""Scans with one mistake each, drawn by seed: fifteen kinds in two sizes, over six geometries and four objects.

The mistakes are those of a geometry file that is filled in wrongly, or of a stack that is read wrongly. The data are
simulated once with the right geometry, by exact line integrals.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import palpate as pp

SHAPE = (88, 100)
MOTIONS = ("arc", "rotating", "circular", "linear", "hypocycloid", "moving panel")
OBJECTS = ("slab", "breast", "head", "trunk")  # the trunk is wider than the panel
PLANAR = ("circular", "linear", "hypocycloid", "moving panel")  # sources in a plane parallel to the panel
KINDS = {  # kind: what the finding's cause may be; first the mistake itself, then the effect of one that is a gauge
    "mirrored angles": ("view order", "object below the panel"),
    "reversed order": ("view order", "object below the panel"),
    "radians": ("angle units",),
    "centimetres": ("length units",),
    "pixel pitch": ("pixel pitch", "length units", "attenuation", "object outside the grid"),
    "source distance": ("source distance", "length units", "attenuation", "object outside the grid"),
    "one view shifted": ("view shifted",),
    "all views shifted": ("panel shifted", "object outside the grid"),
    "rows and columns swapped": ("axes exchanged",),
    "row axis flipped": ("axis flipped", "object outside the grid", "mirrored panel"),
    "panel transposed": ("axes exchanged",),
    "incident": ("incident",),
    "line integrals": ("line integrals",),
    "inverted": ("inverted counts",),
    "grid origin": ("grid origin order", "object outside the grid"),
}


@dataclass(frozen=True)
class Case:
    """What a user hands over: counts, incident, where tube and panel are, and the voxels that he wants."""

    counts: np.ndarray
    incident: float
    source: np.ndarray
    panels: tuple[pp.Panel, ...]
    grid: pp.Grid
    background: float = 0.0

    @property
    def scan(self) -> pp.Scan:
        return pp.Scan(self.counts, self.incident, pp.Views(self.source, self.panels), self.background)


@dataclass(frozen=True)
class Setting:
    """A right scan, and how its geometry is made from the parameters that a user types."""

    motion: str
    thing: str
    make: Callable[..., tuple[np.ndarray, tuple[pp.Panel, ...]]]
    steps: np.ndarray  # angles in degrees, or positions along a line, mm
    case: Case


def panel_at(z: float, pitch: float, shape=SHAPE) -> pp.Panel:
    rows, columns = shape
    return pp.Panel(shape, (pitch, pitch), (-(columns - 1) / 2 * pitch, -(rows - 1) / 2 * pitch, z))


def geometry(rng: np.random.Generator, motion: str, pitch: float):
    """(make, steps, height of the middle of the object): make(steps, unit=degrees to radians, mirror=1)."""
    count, H = int(rng.integers(7, 14)), rng.uniform(600, 1000)
    base = panel_at(0.0, pitch)
    half = rng.uniform(14, 28)
    angles = np.linspace(-half, half, count)
    if motion == "arc":
        pivot = rng.uniform(0, 60)

        def make(steps, turn=np.radians):
            a = turn(steps)
            return np.stack([(H - pivot) * np.sin(a), 0 * a, pivot + (H - pivot) * np.cos(a)], axis=1), (base,) * len(a)

        return make, angles, None
    if motion == "rotating":
        gap, pivot = rng.uniform(80, 300), rng.uniform(-25, 25)  # below the object's middle, which lies near z = 0

        def make(steps, turn=np.radians):
            turns = [np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]) for a in turn(steps)]
            low, at = panel_at(-gap, pitch * (1 + gap / H)), np.array([0, 0, pivot])
            panels = [
                pp.Panel(low.shape, low.pitch, at + R @ (low.origin - at), R @ low.row_axis, R @ low.column_axis)
                for R in turns
            ]
            return np.array([at + R @ (np.array([0, 0, H]) - at) for R in turns]), tuple(panels)

        return make, angles, 0.0
    radius, start = rng.uniform(150, 320), rng.uniform(0, 360)
    if motion == "linear":
        length, towards = rng.uniform(250, 500), np.radians(rng.choice([0, 0, 90, 30]))

        def make(steps, turn=np.radians):
            a = turn(steps) / np.radians(half) * length / 2
            return np.stack([a * np.cos(towards), a * np.sin(towards), 0 * a + H], axis=1), (base,) * len(a)

        return make, angles, None
    fulcrum = rng.uniform(20, 60) if motion == "moving panel" else 0.0

    def make(steps, turn=np.radians):
        t = turn(steps)
        if motion == "hypocycloid":
            path = radius / 3 * np.stack([2 * np.cos(t) + np.cos(2 * t), 2 * np.sin(t) - np.sin(2 * t)], axis=1)
        else:
            path = radius * np.stack([np.cos(t), np.sin(t)], axis=1)
        shift = -path * fulcrum / (H - fulcrum)
        panels = [
            pp.Panel(base.shape, base.pitch, base.origin + (x, y, 0), base.row_axis, base.column_axis) for x, y in shift
        ]
        return np.column_stack([path, np.full(len(t), H)]), tuple(panels)

    return make, start + 360 * np.arange(count) / count, None


def phantom(rng: np.random.Generator, thing: str, middle: float | None) -> pp.Phantom:
    """An object of about 120 mm on the panel, or around `middle`; the trunk is far wider than the panel."""
    gap, s = rng.uniform(2, 25), rng.uniform(0.85, 1.15)
    x, y = rng.uniform(-14, 14, 2)

    def balls(count, width, depth, low, high, z):
        at = rng.uniform(-1, 1, (count, 3)) * np.array([width, width, depth]) * 0.62 + (x, y, z)
        return [
            (pp.Ellipsoid(c, rng.uniform(0.4, 1, 3) * rng.uniform(4, 0.25 * depth + 5)), rng.uniform(low, high))
            for c in at
        ]

    if thing == "slab":
        half = 22 * s
        z = gap + half if middle is None else middle
        body = [(pp.Box((x, y, z), (115 * s, 105 * s, 2 * half)), 0.02)]
        return pp.Phantom(body + balls(9, 45 * s, half, 0.004, 0.03, z))
    if thing == "breast":
        half = 25 * s
        z = gap + half if middle is None else middle
        wall = pp.Box((x, y - 45 + 50 * s, z), (300, 100 * s, 2 * half))
        outline = pp.Intersection([pp.Ellipsoid((x, y - 45, z), (68 * s, 85 * s, 90)), wall])
        inside = pp.Intersection([pp.Ellipsoid((x, y - 40, z), (45 * s, 60 * s, 0.8 * half)), wall])
        y -= 10
        return pp.Phantom([(outline, 0.0456), (inside, 0.015), *balls(6, 35 * s, half, 0.006, 0.03, z)])
    if thing == "head":
        r = np.array([62, 54, 48]) * s
        z = gap + r[2] if middle is None else middle
        skull = [(pp.Ellipsoid((x, y, z), r), 0.045), (pp.Ellipsoid((x, y, z), r - 6), -0.025)]
        return pp.Phantom(skull + balls(7, 30 * s, 30 * s, -0.006, 0.02, z))
    half = 55 * s
    z = gap + half if middle is None else middle
    return pp.Phantom([(pp.Ellipsoid((x, y, z), (200, 150, half)), 0.019), *balls(16, 90, half, -0.008, 0.03, z)])


def grid_around(thing: str, solid: pp.Phantom, views: pp.Views, spacing: float) -> pp.Grid:
    """What a user would ask for: the object and some air around it; of the trunk, the middle of what the views see."""
    low, high = solid.bounds()
    if thing == "trunk":
        seen = pp.covering_grid(views, float(high[2] - low[2]) if low[2] > 0 else 60.0, spacing).bounds
        low[:2], high[:2] = seen[0, :2], seen[1, :2]
    low, high = low - (6, 6, 2), high + (6, 6, 4)
    step = np.array([spacing, spacing, 2 * spacing])
    shape = np.ceil((high - low) / step).astype(int)
    return pp.Grid(shape[::-1], step[::-1], origin=low + step / 2)


def setting(seed: int, motion: str | None = None, thing: str | None = None, photons: float | None = None) -> Setting:
    """A right scan, drawn by seed."""
    rng = np.random.default_rng(seed)
    drawn = str(rng.choice(MOTIONS)), str(rng.choice(OBJECTS)), float(rng.choice([2000, 20000]))
    motion, thing, photons = motion or drawn[0], thing or drawn[1], photons or drawn[2]
    make, steps, middle = geometry(rng, motion, pitch=rng.uniform(2.0, 2.4))
    source, panels = make(steps)
    solid, views = phantom(rng, thing, middle), pp.Views(source, panels)
    counts = pp.simulate_scan(solid, views, photons, seed=seed, subrays=1).counts
    case = Case(counts, photons, source, panels, grid_around(thing, solid, views, 4.0))
    return Setting(motion, thing, make, steps, case)


def _axes(panel: pp.Panel, row, column, keep_centre: bool, shape=None) -> pp.Panel:
    """The panel with other axes, about its centre or about pixel (0, 0)."""
    shape = shape or panel.shape
    turned = pp.Panel(shape, panel.pitch, panel.origin, row, column)
    if not keep_centre:
        return turned
    middle = panel.points((np.array(panel.shape) - 1) / 2)[0]
    return pp.Panel(
        shape, panel.pitch, panel.origin + middle - turned.points((np.array(shape) - 1) / 2)[0], row, column
    )


def _scaled(panel: pp.Panel, lengths: float = 1.0, pitch: float = 1.0) -> pp.Panel:
    """All lengths scaled, or the pitch alone about the centre."""
    big = pp.Panel(
        panel.shape, np.array(panel.pitch) * lengths * pitch, panel.origin, panel.row_axis, panel.column_axis
    )
    middle = (np.array(panel.shape) - 1) / 2
    origin = lengths * panel.points(middle)[0] + big.origin - big.points(middle)[0]
    return pp.Panel(big.shape, big.pitch, origin, big.row_axis, big.column_axis)


def _moved(panel: pp.Panel, rows: float, columns: float) -> pp.Panel:
    origin = panel.points((rows, columns))[0]
    return pp.Panel(panel.shape, panel.pitch, origin, panel.row_axis, panel.column_axis)


def mistaken(found: Setting, kind: str, size: int, rng: np.random.Generator) -> Case:
    """The case with one mistake; size is 0 or 1. Raises what palpate raises where it refuses the geometry at once."""
    c, make, steps = found.case, found.make, found.steps
    if kind in ("mirrored angles", "reversed order") and size == 1:  # a sweep to one side more than to the other
        kept = slice(0, max(5, round(0.7 * len(steps))))
        steps = steps[kept]
        c = replace(c, counts=c.counts[kept], source=c.source[kept], panels=c.panels[kept])
    if kind == "mirrored angles":
        source, panels = make(-steps)
        return replace(c, source=source, panels=panels)
    if kind == "reversed order":
        return replace(c, counts=c.counts[::-1])
    if kind == "radians":
        source, panels = make(np.radians(steps)) if size == 0 else make(steps, turn=np.asarray)
        return replace(c, source=source, panels=panels)
    if kind == "centimetres":
        panels = c.panels if size else tuple(_scaled(p, lengths=0.1) for p in c.panels)
        return replace(c, source=c.source / 10, panels=panels)
    if kind == "pixel pitch":
        return replace(c, panels=tuple(_scaled(p, pitch=(10, 0.5)[size]) for p in c.panels))
    if kind == "source distance":
        middle = np.mean([p.points((np.array(p.shape) - 1) / 2)[0] for p in c.panels], axis=0)
        return replace(c, source=middle + (0.8, 0.6)[size] * (c.source - middle))
    if kind in ("one view shifted", "all views shifted"):
        pixels, turn = ((5, 10) if kind[0] == "o" else (5, 15))[size], rng.uniform(0, 2 * np.pi)
        by, one = pixels * np.array([np.sin(turn), np.cos(turn)]), rng.integers(len(c.panels))
        panels = [_moved(p, *by) if kind[0] == "a" or k == one else p for k, p in enumerate(c.panels)]
        return replace(c, panels=tuple(panels))
    if kind == "rows and columns swapped":
        return replace(c, panels=tuple(_axes(p, p.column_axis, p.row_axis, size == 0) for p in c.panels))
    if kind == "row axis flipped":
        return replace(c, panels=tuple(_axes(p, -p.row_axis, p.column_axis, size == 0) for p in c.panels))
    if kind == "panel transposed":
        turned = np.swapaxes(c.counts, 1, 2)
        turned = turned[:, ::-1] if size else turned
        return replace(
            c, counts=turned, panels=tuple(_axes(p, p.row_axis, p.column_axis, True, p.shape[::-1]) for p in c.panels)
        )
    if kind == "incident":
        return replace(c, incident=c.incident * (0.01, 3)[size])
    l = -np.log(np.maximum(c.counts, 0.5) / c.incident)
    if kind == "line integrals":
        return replace(c, counts=np.maximum(l, 0) if size == 0 else np.round(np.clip(l, 0, None) * 1000))
    if kind == "inverted":
        return replace(c, counts=np.maximum(c.incident - c.counts, 0) if size == 0 else c.counts.max() - c.counts)
    if kind == "grid origin":
        move = np.zeros(3) if size == 0 else -c.grid.bounds[0] + (20, 90, 45)  # another zero of the same room
        source, panels = c.source + move, [replace_origin(p, p.origin + move) for p in c.panels]
        x, y, z = np.array(c.grid.origin) + move
        grid = pp.Grid(c.grid.shape, c.grid.spacing, origin=(z, y, x))
        return replace(c, source=source, panels=tuple(panels), grid=grid)
    raise KeyError(kind)


def replace_origin(panel: pp.Panel, origin) -> pp.Panel:
    return pp.Panel(panel.shape, panel.pitch, origin, panel.row_axis, panel.column_axis)


def disturbed(found: Setting, how: str, rng: np.random.Generator) -> Case:
    """A right scan with what real ones have: scatter that nobody corrected, gains that drift by 2 %, or neither."""
    c = found.case
    if how == "scatter":  # a tenth of the open beam's primary behind the object, smooth; not told to the program
        glow = 0.1 * c.counts.mean(axis=(1, 2), keepdims=True)
        return replace(c, counts=c.counts + rng.poisson(np.broadcast_to(glow, c.counts.shape)))
    if how == "gain drift":
        gains = 1 + 0.02 * rng.uniform(-1, 1, len(c.counts))
        return replace(c, counts=c.counts * gains[:, None, None])
    return c
