"""What Matplotlib draws, as strokes that a browser can repeat.

One set of artists for the screen and for print.

    scene = Scene(view)
    message, buffers = scene.picture(ratio=2.0)   # everything at first, then only what has changed
    Recorder(agg)                                 # the renderer: artist.draw(recorder); .take()

A message says {"size": [width, height], "order": [part, …], "ops": {part: [op, …]}}, `order` only
when the still part is new. Parts are drawn in that order: "s0", "s1", … are the still pieces, "m0",
"m1", … the moving artists. Points are pixels of the device, y downwards, in one float32 buffer;
(NaN, 0) lifts the pen, (NaN, 1) closes the stroke. An op has
  n                   number of its points; and with them stroke, width, dash, cap, join, fill, clip
                      [x, y, width, height]
  apart               each stroke is laid over those before it, where otherwise all of them make one
                      shape
  at                  the stroke is a marker: its number of places, which follow its n points
  image [x, y, w, h]  a bitmap of the second buffer: of one channel, the cover of the colour `fill`
                      (text), or "rgba"
"""

from __future__ import annotations

import io
import re
from functools import partial
from math import floor
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backend_bases import GraphicsContextBase, RendererBase
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, Transform

from .figure import CSS_DPI, pixels, style
from .private import measure_as


class Recorder(RendererBase):
    """Recorder(agg): a Matplotlib renderer that notes strokes instead of drawing them.

    Of the size and resolution of a RendererAgg.

    Paths are cleaned as Agg does it (no NaN, cut off outside, snapped to pixels, simplified);
    curves become polylines. What has no counterpart here (images, hatches, clipping by a curve,
    shaded triangles) Agg draws, and a bitmap of it is noted.
    """

    def __init__(self, agg: RendererAgg):
        super().__init__()
        self.agg, self.width, self.height, self.dpi = agg, agg.width, agg.height, agg.dpi
        self.flip = Affine2D().scale(1, -1).translate(0, self.height)
        measure_as(self, agg)
        self.get_canvas_width_height = agg.get_canvas_width_height
        self.points_to_pixels = agg.points_to_pixels
        self.images: dict[tuple, tuple] = {}  # text as bitmaps, the newest ones
        self.markers: dict[tuple, tuple] = {}  # shapes of markers, and how far off their places
        self.ops: list[dict] = []
        self.points: list[np.ndarray] = []
        self.bitmaps: list[bytes] = []

    def take(self) -> tuple[list[dict], list[np.ndarray], list[bytes]]:
        """recorder.take() -> ops, their points and their bitmaps since the last call."""
        taken = self.ops, self.points, self.bitmaps
        self.ops, self.points, self.bitmaps = [], [], []
        return taken

    # -- strokes: arguments are as in RendererBase -------------------------------------------------

    def draw_path(self, gc, path, transform, rgbFace=None, apart=False) -> None:
        if gc.get_hatch() or gc.get_clip_path()[0] is not None:
            return self._by_agg("draw_path", gc, path, transform, rgbFace)
        look, width = self._look(gc, rgbFace)
        if look:
            # Where a stroke runs over another, Agg adds up what both cover of a pixel; so does one
            # laid over the other, if it hides what is below.
            if apart or (rgbFace is None and look["stroke"].endswith("ff")):
                look["apart"] = True
            area, margin = None, width + 2
            if rgbFace is None:
                clip = look.get("clip") if "dash" not in look else None  # a cut begins a dash anew
                x, y, w, h = clip or (0, 0, self.width, self.height)
                area = x - margin, y - margin, x + w + margin, y + h + margin
            self._note(look, _polyline(path, transform + self.flip, gc, width, area))

    def draw_markers(self, gc, marker_path, marker_trans, path, trans, rgbFace=None) -> None:
        if gc.get_clip_path()[0] is not None or gc.get_hatch():
            return self._by_agg("draw_markers", gc, marker_path, marker_trans, path, trans, rgbFace)
        look, width = self._look(gc, rgbFace)
        vertices = path.vertices
        if path.codes is not None:
            vertices = vertices[np.isin(path.codes, (Path.MOVETO, Path.LINETO))]
        places = (trans + self.flip).transform(vertices)
        x, y, w, h = look.get("clip", (0, 0, self.width, self.height))
        reach = 3 * self.dpi  # no marker is wider
        with np.errstate(invalid="ignore"):
            low, high = places > (x - reach, y - reach), places < (x + w + reach, y + h + reach)
        places = np.floor(places[(low & high).all(axis=1)] + 0.5)  # as Agg does it
        if look and len(places):
            codes, snap = marker_path.codes, gc.get_snap()
            arrays = (marker_path.vertices, marker_trans.get_matrix())
            key = (*map(bytes, arrays), codes is not None and bytes(codes), snap, width)
            if key not in self.markers:
                plain = marker_path.cleaned(marker_trans, curves=False, snap=False)
                options = {"curves": False, "snap": snap, "stroke_width": width}
                snapped = marker_path.cleaned(marker_trans, **options)
                on_pixels = not np.array_equal(plain.vertices, snapped.vertices)
                upright = marker_trans + Affine2D().scale(1, -1)
                shape = _polyline(marker_path, upright, gc, width, None)
                self.markers[key] = shape, 0.0 if on_pixels else 0.5
            shape, off = self.markers[key]
            self._note({**look, "at": len(places)}, shape, places + off)

    def draw_path_collection(
        self, gc, master, paths, all_transforms, offsets, offset_trans, facecolors, *looks, **more
    ) -> None:
        edges, widths, dashes = looks[:3]
        if (
            len(paths) > 1
            and not len(all_transforms)
            and not np.any(offset_trans.transform(offsets))
            and not len(facecolors)
            and not gc.get_hatch()
            and len(edges) == len(widths) == len(dashes) == 1
            and all(path.codes is None for path in paths)
        ):
            gc.set_foreground(edges[0], isRGBA=True)
            gc.set_linewidth(widths[0])
            gc.set_dashes(*dashes[0])
            points = np.concatenate([part for path in paths for part in (path.vertices, _UP)])
            return self.draw_path(gc, Path(points), master, apart=True)
        whole = (gc, master, paths, all_transforms, offsets, offset_trans, facecolors, *looks)
        super().draw_path_collection(*whole, **more)

    def _look(self, gc: GraphicsContextBase, face: Any) -> tuple[dict[str, Any], float]:
        """The style of an op (empty: it leaves no trace), and the width that snapping goes by."""
        rgb, width = gc.get_rgb(), self.points_to_pixels(gc.get_linewidth())
        look: dict[str, Any] = {}
        if face is not None:
            alpha = gc.get_alpha() if gc.get_forced_alpha() or len(face) == 3 else face[3]
            if alpha > 0:
                look["fill"] = to_hex((*face[:3], alpha), keep_alpha=True)
        if width > 0 and rgb[3] > 0:
            look |= {"stroke": to_hex(rgb, keep_alpha=True), "width": width}
            look |= {"cap": _CAPS[gc.get_capstyle()], "join": gc.get_joinstyle()}
            offset, dashes = gc.get_dashes()
            if dashes:
                look["dash"] = [*map(self.points_to_pixels, (offset, *dashes))]
        return (look | self._clip(gc) if look else look), (width if rgb[3] > 0 else 0.0)

    def _clip(self, gc: GraphicsContextBase) -> dict[str, Any]:
        box = gc.get_clip_rectangle()
        if box is None:
            return {}
        high = self.height
        left, right = (min(max(floor(x + 0.5), 0), int(self.width)) for x in (box.x0, box.x1))
        top, bottom = (min(max(floor(high - y + 0.5), 0), int(high)) for y in (box.y1, box.y0))
        return {"clip": [left, top, right - left, bottom - top]}

    def _note(self, look: dict[str, Any], *points: np.ndarray) -> None:
        if len(points[0]):
            self.ops.append({**look, "n": len(points[0])})
            self.points.extend(points)

    # -- bitmaps -----------------------------------------------------------------------------------

    def draw_text(self, gc, x, y, s, prop, angle, ismath=False, mtext=None) -> None:
        left, top = floor(x), floor(y)
        at = round(64 * (x - left)), round(64 * (y - top))  # Agg sets letters to 1/64 of a pixel
        key = (s, hash(prop), angle, gc.get_rgb(), ismath, *at)
        if key not in self.images:
            width, height, descent = self.get_text_width_height_descent(s, prop, ismath)
            box = [(a, b) for a in (-2, width + 3) for b in (-height - 3, descent + 3)]
            corners = Affine2D().rotate_deg(-angle).transform(box)
            (x0, y0), (x1, y1) = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
            own = self.new_gc()
            own.copy_properties(gc)
            own.set_clip_rectangle(None)
            agg = RendererAgg(x1 - x0 + 2, y1 - y0 + 2, self.dpi)
            draw = agg.draw_tex if ismath == "TeX" else partial(agg.draw_text, ismath=ismath)
            draw(own, x - left - x0, y - top - y0, s, prop, angle, mtext=mtext)
            if len(self.images) > 500:
                self.images.clear()
            self.images[key] = _cut(np.asarray(agg.buffer_rgba()), int(x0), int(y0))
        image, dx, dy = self.images[key]
        look = {"fill": to_hex(gc.get_rgb()), **self._clip(gc)}
        self._note_image(image[..., 3], left + dx, top + dy, look)

    def draw_image(self, gc, x, y, im, transform=None) -> None:
        self._by_agg("draw_image", gc, x, y, im)

    def draw_gouraud_triangles(self, gc, triangles, colors, transform) -> None:
        self._by_agg("draw_gouraud_triangles", gc, triangles, colors, transform)

    def draw_tex(self, gc, x, y, s, prop, angle, *, mtext=None) -> None:
        self.draw_text(gc, x, y, s, prop, angle, "TeX", mtext)

    def _by_agg(self, method: str, *arguments: Any) -> None:
        agg = RendererAgg(self.width, self.height, self.dpi)
        getattr(agg, method)(*arguments)
        self._note_image(*_cut(np.asarray(agg.buffer_rgba()), 0, 0), {"rgba": True})

    def _note_image(self, image: np.ndarray, x: int, y: int, look: dict[str, Any]) -> None:
        if image.size:
            self.ops.append({**look, "image": [x, y, image.shape[1], image.shape[0]]})
            self.bitmaps.append(image.tobytes())


_UP = np.full((1, 2), np.nan)
_CAPS = {"butt": "butt", "round": "round", "projecting": "square"}


def _polyline(
    path: Path,
    transform: Transform,
    gc: GraphicsContextBase,
    width: float,
    area: tuple[float, float, float, float] | None,
) -> np.ndarray:
    """The cleaned path as points (n, 2).

    A NaN in x where the pen goes up (y = 0) or the stroke is closed (y = 1). No area: nothing is
    cut off.
    """
    clean = path.cleaned(
        transform,
        remove_nans=True,
        clip=area,
        simplify=path.should_simplify and area is not None,
        curves=False,
        stroke_width=width,
        snap=gc.get_snap(),
        sketch=gc.get_sketch_params(),
    )
    points, codes = clean.vertices[:-1], clean.codes[:-1]  # the last one says stop
    closed = codes == Path.CLOSEPOLY
    points[closed] = np.nan, 1.0
    lifts = np.flatnonzero((codes[1:] == Path.MOVETO) & ~closed[:-1]) + 1
    return np.insert(points, lifts, (np.nan, 0.0), axis=0) if len(lifts) else points


def _cut(pixels: np.ndarray, x: int, y: int) -> tuple[np.ndarray, int, int]:
    """The part of a bitmap that shows something, and its corner."""
    rows, columns = (np.flatnonzero(pixels[..., 3].any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return pixels[:0, :0].copy(), x, y
    shown = pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].copy()
    return shown, x + int(columns[0]), y + int(rows[0])


def _fix_colors(artist: Artist) -> None:
    """Lines look up a colour of the cycle, "C1", whenever they are drawn.

    Entering the house style for each picture would take longer than drawing it.
    """
    if isinstance(artist, Line2D):
        for part in ("color", "markerfacecolor", "markeredgecolor"):
            color = getattr(artist, f"get_{part}")()
            if isinstance(color, str) and re.fullmatch(r"C\d+", color):
                getattr(artist, f"set_{part}")(to_hex(color))


class Scene:
    """Scene(view): the figure of a view as messages for a canvas.

    Of its moving artists only those that were changed are drawn again.

    scene.picture(ratio)    -> message, buffers: what has changed; `ratio` is the number of device
                            pixels to one CSS pixel
    Anything else that changes (limits, a title) is noticed by Matplotlib's own `stale`; then all is
    drawn again. Axes keep their places, so that nothing jumps under the hand, until `settled` asks
    for a new layout. `everything` says that nothing is known there yet.
    """

    def __init__(self, view: Any):
        self.view, self.figure = view, view.figure
        self.artists: list[Artist] = []
        self.changed: set[Artist] = set()
        self.ratio, self.zoom, self.still, self.placed = 0.0, 1.0, False, True
        self.drawn: dict[Any, list] = {}  # parts of each axes, in drawing order
        self.figure.stale_callback = lambda figure, value: self.forget()

    def forget(self) -> None:
        self.still = False

    def picture(
        self, ratio: float = 1.0, settled: bool = True, everything: bool = False
    ) -> tuple[dict[str, Any], list[bytes]]:
        if ratio * self.zoom != self.ratio:
            self.ratio = ratio * self.zoom
            self.figure.dpi = CSS_DPI * self.ratio
            self.recorder = Recorder(self.figure.canvas.get_renderer())
            self.drawn = {}
            self.forget()
        if self.artists != (artists := list(self.view.artists)):
            self.artists = artists
            with style():
                for artist in artists:
                    _fix_colors(artist)
                    # and not the figure's business
                    artist.stale_callback = lambda artist, value: self.changed.add(artist)
            self.drawn = {}
            self.forget()
        message: dict[str, Any] = {"size": [int(self.recorder.width), int(self.recorder.height)]}
        parts: dict[str, tuple] = {}
        again = not self.still or (settled and not self.placed)
        if again:
            self._draw_still(settled)
        if again or everything:
            message["order"], parts, self.changed = self.order, dict(self.parts), set(artists)
        for k, artist in enumerate(artists):
            if artist in self.changed:
                if not isinstance(artist, Line2D) or len(artist.get_xdata(orig=True)):
                    artist.draw(self.recorder)
                parts[f"m{k}"] = self.recorder.take()
        self.changed.clear()
        message["ops"] = {name: part[0] for name, part in parts.items()}
        points = [array for part in parts.values() for array in part[1]]
        return message, [
            np.concatenate(points).astype("<f4").tobytes() if points else b"",
            b"".join(image for part in parts.values() for image in part[2]),
        ]

    def bitmap(self) -> bytes:
        """scene.bitmap() -> the whole picture as JPEG, drawn by Agg.

        For pictures with more points than a browser can stroke in time.
        """
        renderer = self.figure.canvas.get_renderer()
        with style():
            self.figure.draw(renderer)
        file = io.BytesIO()
        # full colour resolution: thin coloured lines stay clean
        pixels(renderer).save(file, "JPEG", quality=88, subsampling=0)
        self.forget()
        return file.getvalue()

    def _draw_still(self, settled: bool) -> None:
        """Lets the figure draw itself; where it comes to a moving artist, a new part begins.

        Axes that stay as they are, while others are zoomed, repeat theirs.
        """
        # as long as Figure.draw has not declared all of them so
        stale = [axes for axes in self.figure.axes if axes.stale]
        recorder, known, self.drawn = self.recorder, {} if settled else self.drawn, {}
        recorder.take()
        self.parts: dict[str, tuple] = {}
        self.order: list[str] = []

        def keep() -> None:
            if recorder.ops:
                self.order.append(f"s{len(self.parts)}")
                self.parts[self.order[-1]] = recorder.take()

        def hold(name: str, renderer: Any) -> None:
            if renderer is recorder:  # else the layout measures
                keep()
                self.order.append(name)

        def draw_axes(axes: Any, renderer: Any) -> None:
            keep()
            begin, old = len(self.order), known.get(axes)
            if old is None or axes in stale:
                type(axes).draw(axes, renderer)
                keep()
                self.drawn[axes] = [(name, self.parts.get(name)) for name in self.order[begin:]]
            else:
                self.drawn[axes] = old
                for name, part in old:
                    self.order.append(name if part is None else f"s{len(self.parts)}")
                    if part is not None:
                        self.parts[self.order[-1]] = part

        with style():
            for k, artist in enumerate(self.artists):
                artist.draw = partial(hold, f"m{k}")  # type: ignore[method-assign]
            for axes in self.figure.axes:
                axes.draw = partial(draw_axes, axes)  # type: ignore[method-assign]
            self.figure.frozen = not settled
            try:
                self.figure.draw(recorder)
            finally:
                self.figure.frozen = False
                for artist in (*self.artists, *self.figure.axes):
                    del artist.draw
        keep()
        self.still, self.placed = True, settled
