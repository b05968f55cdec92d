"""Panels put together: title and colour bar around them by matplotlib, films of them by pillow."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from physics.view.drawing import Pixels
from physics.whole import write_whole

DPI = 100  # [pixels per inch]


class Page:
    """A figure with one or two panels, a title and a colour bar, filled again for every frame of a film."""

    def __init__(self, panels: Sequence[Pixels], names: Sequence[str], limits: tuple[float, float], cmap: str, label: str):
        height, width = panels[0].shape[:2]
        above, below = 76, 74  # [pixels] for title and colour bar
        self.figure = Figure(figsize=(width * len(panels) / DPI, (height + above + below) / DPI), dpi=DPI, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)
        whole = height + above + below
        self.images = []
        for i, (panel, name) in enumerate(zip(panels, names, strict=True)):
            axes = self.figure.add_axes((i / len(panels), below / whole, 1 / len(panels), height / whole))
            axes.set_axis_off()
            self.images.append(axes.imshow(panel, interpolation="none", aspect="auto"))
            self.figure.text((i + 0.5) / len(panels), 1 - 66 / whole, name, ha="center", fontsize=11, color="#444444")
        self.title = self.figure.text(0.5, 1 - 30 / whole, "", ha="center", fontsize=13, color="#111111")
        bar = self.figure.add_axes((0.3, 46 / whole, 0.4, 12 / whole))
        colours = ScalarMappable(Normalize(*limits), colormaps[cmap])
        self.figure.colorbar(colours, cax=bar, orientation="horizontal").outline.set_visible(False)
        bar.tick_params(labelsize=9, length=2, color="#444444", labelcolor="#444444")
        bar.set_xlabel(label, fontsize=10, color="#444444", labelpad=2)

    def show(self, panels: Sequence[Pixels], title: str) -> Image.Image:
        for image, panel in zip(self.images, panels, strict=True):
            image.set_data(panel)
        self.title.set_text(title)
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())


def write_picture(path: str | Path, picture: Image.Image, **options: Any) -> None:
    """Write a picture as what its name ends in, whole or not at all; its folder is made. Raises OSError naming the file."""
    content = BytesIO()  # made in memory, because the name to write to at first has another ending
    picture.save(content, Image.registered_extensions()[Path(path).suffix.lower()], **options)
    write_whole(path, content.getvalue())


def write_film(path: str | Path, pictures: list[Image.Image], durations: list[int]) -> None:
    """A GIF that runs for ever; durations [ms]. One palette for all pictures, so that colours do not flicker."""
    few = [np.asarray(picture) for picture in pictures[::max(1, len(pictures) // 4)] + pictures[-1:]]
    palette = Image.fromarray(np.concatenate(few)).quantize(256, method=Image.Quantize.MEDIANCUT)
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    write_picture(path, pictures[0], save_all=True, append_images=pictures[1:], duration=durations, loop=0)
