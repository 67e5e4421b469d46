"""Empty panels, which the studies draw on."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = TRUTH = "#1c2530"


def canvas(count: int, height: float = 3.8) -> tuple[Figure, list[Axes]]:
    """So many panels side by side."""
    figure = Figure(figsize=(12.8 if count > 1 else 7.5, height), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False)[0])


def finish(axes: Axes, title: str, xlabel: str, ylabel: str, size: float = 10) -> None:
    """Titles, labels, a faint grid, no box. size: of the title's letters; the others are smaller."""
    axes.set_title(title, fontsize=size, color=INK)
    axes.set_xlabel(xlabel, fontsize=size - 1)
    axes.set_ylabel(ylabel, fontsize=size - 1)
    axes.tick_params(labelsize=size - 2)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)


def legend_below(figure: Figure, axes: Axes, columns: int = 7, size: float = 9) -> None:
    """The legend of one panel, below all."""
    handles, labels = axes.get_legend_handles_labels()
    columns = min(columns, len(labels))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=size)
