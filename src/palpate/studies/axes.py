"""Empty panels and their colours: what the studies' curves are drawn on."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.studies.pictures import INK

COLOURS = ("#0b6e99", "#e76f51", "#2a9d8f", "#8d5fb0", "#b8860b", "#5b6775", "#c2185b")
TRUTH = "#1c2530"


def canvas(count: int, height: float = 3.8) -> tuple[Figure, list[Axes]]:
    """So many panels side by side."""
    figure = Figure(figsize=(12.8 if count > 1 else 7.5, height), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False)[0])


def finish(axes: Axes, title: str, xlabel: str, ylabel: str) -> None:
    """Titles, labels, a faint grid, no box."""
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_xlabel(xlabel, fontsize=9)
    axes.set_ylabel(ylabel, fontsize=9)
    axes.tick_params(labelsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(alpha=0.25)
