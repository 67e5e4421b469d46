"""Figures that a notebook shows. Their layout is computed here, which is faster than Matplotlib's."""

import base64
import html
import io
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from palpate.arrays import AnyArray

BARS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)  # mm
WIDTH, TALLEST = 11.0, 8.0  # inches
TITLE, GAP, BAR = 0.3, 0.1, 1.0  # inches above a frame, between frames, for the colour bar
DPI = 100
COLOURS = ("#0b6e99", "#e76f51", "#2a9d8f", "#8d5fb0", "#b8860b", "#5b6775", "#c2185b")
DASHES, MARKERS = ("-", "--", "-.", (0, (2, 1))), ("o", "s", "^", "D", "v", "P", "X")


class Picture(Figure):
    """A Matplotlib figure that shows itself in a notebook, without pyplot and its global state."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=DPI, pil_kwargs={"compress_level": 3})
        return file.getvalue()


def line_style(i: int) -> dict[str, Any]:
    """How to plot curve i: no two of 28 have the dashes and the markers of another, so none needs its colour."""
    return {"color": COLOURS[i % 7], "ls": DASHES[i % 4], "marker": MARKERS[i % 7], "ms": 4, "markevery": 0.12}


def html_block(words: str, picture: Picture) -> str:
    """A text above an image, as HTML for a notebook."""
    data = base64.b64encode(picture._repr_png_()).decode()
    text = html.escape(words)
    image = f"<img alt='{text}' style='max-width:100%' src='data:image/png;base64,{data}'>"
    return f"<div><p style='margin:0 0 4px'>{text}</p>{image}</div>"


def figure_of_frames(
    rows: Sequence[Sequence[tuple[float, float]]], tallest: float = TALLEST
) -> tuple[Picture, list[Axes]]:
    """A figure at most `tallest` inches high, with rows of frames (width, height) mm, all to one scale.

    Last of the axes is one for a colour bar.
    """
    wide = max(sum(width for width, _ in row) for row in rows)
    tall = sum(max(height for _, height in row) for row in rows)
    most = max(len(row) for row in rows)
    room = WIDTH - BAR - GAP * most
    scale = min(room / wide, (tallest - TITLE * len(rows)) / tall)  # inches a mm
    size = (WIDTH, tall * scale + TITLE * len(rows) + 0.05)
    figure = Picture(figsize=size)
    axes = []
    top = size[1]
    for row in rows:
        top -= TITLE + max(height for _, height in row) * scale
        left = 0.05
        for width, height in row:
            place = (left / size[0], top / size[1], width * scale / size[0], height * scale / size[1])
            frame = figure.add_axes(place)
            frame.set_axis_off()
            axes.append(frame)
            left += width * scale + GAP
    left = (0.05 + wide * scale + GAP * most) / size[0]
    height = size[1] - TITLE - 0.15
    axes.append(figure.add_axes((left, 0.1 / size[1], 0.14 / size[0], height / size[1])))
    return figure, axes


def draw_image(frame: Axes, values: AnyArray, size: tuple[float, float], window: tuple[float, float]) -> ScalarMappable:
    """Values (rows, columns) in a frame of size (width, height) mm, row 0 above, with a scale bar."""
    width, height = size
    picture = frame.imshow(
        values,
        cmap="gray",
        vmin=window[0],
        vmax=window[1],
        origin="upper",
        extent=(0, width, height, 0),
        interpolation="nearest",
        aspect="auto",
    )
    length = max((b for b in BARS if b <= width / 3), default=BARS[0])
    right, low = 0.97, 0.05
    frame.plot([right - length / width, right], [low, low], transform=frame.transAxes, color="white", lw=2)
    write_on(frame, right - length / width / 2, low + 0.02, f"{length:g} mm", "center", "bottom")
    return picture


def write_on(frame: Axes, x: float, y: float, words: str, ha: str, va: str) -> None:
    """White words with a dark rim, to be read on black and on white; x and y are shares of the frame."""
    rim = [withStroke(linewidth=2, foreground="black")]
    frame.text(x, y, words, transform=frame.transAxes, color="white", fontsize=9, ha=ha, va=va, path_effects=rim)


def title(frame: Axes, words: str) -> None:
    """A title above a frame; Matplotlib's own titles take longer than the image."""
    frame.text(0.5, 1.0, f"{words}\n", transform=frame.transAxes, fontsize=8, ha="center", va="center", linespacing=1.6)
