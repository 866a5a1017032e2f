"""The recording renderer: what it notes, painted again by Agg, is what Matplotlib draws."""

import io
import json

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.colors import to_rgba
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, Bbox
from PIL import Image

from labkit import figure, phase_portrait, simulate, time_plot
from labkit.draw.figure import HALO, style
from labkit.draw.record import Scene
from labkit.draw.view import Together

from .systems import ball, stick_slip


class Picture:
    """Any figure as a view: everything is still but the artists named."""

    def __init__(self, figure, *artists):
        self.figure, self.artists = figure, list(artists)


def replayed(message, buffers):
    """The message as pixels.

    Its strokes go through a plain Agg renderer, so that only the notes are tested and no browser.
    """
    message = json.loads(json.dumps(message))  # what arrives
    points, pixels = (
        np.frombuffer(buffers[0], "<f4").reshape(-1, 2).astype(float),
        np.frombuffer(buffers[1], np.uint8),
    )
    width, height = message["size"]
    agg, flip = RendererAgg(width, height, 72.0), Affine2D().scale(1, -1).translate(0, height)
    at, byte, prepared = 0, 0, {}
    for name, ops in message["ops"].items():
        prepared[name] = []
        for op in ops:
            count = op.get("n", 0) + op.get("at", 0)
            if "image" in op:
                size = op["image"][2] * op["image"][3] * (4 if op.get("rgba") else 1)
                prepared[name].append((op, pixels[byte : byte + size]))
                byte += size
            else:
                prepared[name].append((op, points[at : at + count]))
                at += count
    assert at == len(points) and byte == len(pixels)  # nothing is left over
    for name in message["order"]:
        for op, data in prepared[name]:
            gc = agg.new_gc()
            if "clip" in op:
                x, y, w, h = op["clip"]
                gc.set_clip_rectangle(Bbox.from_bounds(x, height - y - h, w, h))
            if "image" in op:
                x, y, w, h = op["image"]
                if op.get("rgba"):
                    rgba = data.reshape(h, w, 4)
                else:
                    rgba = np.empty((h, w, 4), np.uint8)
                    rgba[..., :3], rgba[..., 3] = (
                        (255 * np.array(to_rgba(op["fill"])[:3])).round(),
                        data.reshape(h, w),
                    )
                agg.draw_image(gc, x, height - y - h, rgba[::-1].copy())
                continue
            gc.set_foreground(to_rgba(op.get("stroke", "#0000")), isRGBA=True)
            gc.set_linewidth(op.get("width", 0.0))
            gc.set_snap(False)
            if "dash" in op:
                gc.set_dashes(op["dash"][0], op["dash"][1:])
            if "stroke" in op:
                gc.set_capstyle({"square": "projecting"}.get(op["cap"], op["cap"]))
                gc.set_joinstyle(op["join"])
            face = to_rgba(op["fill"]) if "fill" in op else None
            for path in paths(data[: op["n"]], op.get("apart")):
                for place in data[op["n"] :] if "at" in op else [(0.0, 0.0)]:
                    agg.draw_path(gc, path, Affine2D().translate(*place) + flip, face)
    return np.asarray(agg.buffer_rgba())[..., :3].astype(int)


def paths(points, apart):
    vertices, codes, down = [], [], False
    for x, y in points:
        if np.isnan(x):
            down = False
            if y == 1:
                vertices.append((0, 0))
                codes.append(Path.CLOSEPOLY)
        else:
            vertices.append((x, y))
            codes.append(Path.LINETO if down else Path.MOVETO)
            down = True
    whole = Path(vertices, codes)
    if not apart:
        return [whole]
    cuts = [*np.flatnonzero(whole.codes == Path.MOVETO), len(codes)]
    return [
        Path(whole.vertices[a:b], whole.codes[a:b])
        for a, b in zip(cuts[:-1], cuts[1:], strict=True)
    ]


def drawn(fig):
    with style():
        FigureCanvasAgg.draw(fig.canvas)
    return np.asarray(fig.canvas.buffer_rgba())[..., :3].astype(int)


def same(view, ratio=1.0, mean=0.05, far=0.0005):
    """The replayed message against the drawing of the same figure."""
    message, buffers = Scene(view).picture(ratio)
    mine, theirs = replayed(message, buffers), drawn(view.figure)
    assert mine.shape == theirs.shape
    off = np.abs(mine - theirs)
    assert off.mean() < mean and (off.max(axis=2) > 32).mean() < far, (
        off.mean(),
        (off.max(axis=2) > 32).mean(),
    )
    assert (theirs < 128).any()  # there is something to see


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0])
def test_time_plot_and_portrait(ratio):
    run = simulate(stick_slip(), 12.0)
    fig = figure(1, 2, width=10)
    curves = time_plot(run, ("x", "V"), axes=fig.axes[0])
    view = phase_portrait(run.system, "x", "V", starts=6, horizon=4.0, run=run, axes=fig.axes[1])
    same(
        Picture(fig, *curves.artists, *view.artists), ratio, mean=0.1, far=0.0015
    )  # strokes laid over each other, not added up


def test_events_jumps_modes_and_legend():
    view = time_plot(simulate(ball(), 12.0), "y", "v")
    same(view)
    same(view, 2.0)


@pytest.mark.parametrize(
    "kind",
    [
        "curves",
        "markers",
        "scatter",
        "image",
        "hatch",
        "clip",
        "text",
        "polar",
        "quiver",
        "log",
        "fill",
        "mesh",
    ],
)
def test_kinds_of_artists(kind):
    fig = figure(width=4, height=3)
    axes, rng, x = fig.axes[0], np.random.default_rng(1), np.linspace(0, 6, 200)
    if kind == "curves":
        moving = [
            axes.add_patch(
                Ellipse(
                    (3, 0), 4, 1, facecolor="#0072B280", edgecolor="k", linewidth=3, linestyle="--"
                )
            )
        ]
        moving += axes.plot(
            x, np.sin(x) + np.where((x > 2) & (x < 3), np.nan, 0), linewidth=3, alpha=0.4
        )
    elif kind == "markers":
        moving = [
            *axes.plot(x[::20], np.sin(x[::20]), "o--", markersize=7, markerfacecolor="w"),
            *axes.plot(x[::30], np.cos(x[::30]), "X", color="C1", markersize=9),
        ]
    elif kind == "scatter":
        moving = [
            axes.scatter(
                *rng.normal(size=(2, 60)),
                s=rng.uniform(5, 200, 60),
                c=rng.uniform(size=60),
                alpha=0.5,
            )
        ]
    elif kind == "image":
        moving = [
            axes.imshow(rng.uniform(size=(20, 30)), aspect="auto"),
            *axes.plot([2, 25], [3, 15], "w"),
        ]
    elif kind == "hatch":
        moving = [
            axes.add_patch(
                Rectangle((0.2, 0.2), 0.5, 0.4, hatch="//", facecolor="#EEEEEE", edgecolor="k")
            )
        ]
    elif kind == "clip":
        moving = axes.plot(x, np.sin(x), linewidth=4)
        moving[0].set_clip_path(Ellipse((3, 0), 4, 1, transform=axes.transData))
    elif kind == "text":
        moving = [
            axes.text(0.1, 0.2, "plain äµ − 3", rotation=30),
            axes.text(0.3, 0.6, r"$\frac{a}{b}\,\dot x_1$", fontsize=20, color="C1", alpha=0.6),
            axes.text(
                0.6, 0.3, "halo", path_effects=HALO, bbox={"facecolor": "w", "edgecolor": "C2"}
            ),
        ]
    elif kind == "polar":
        fig = figure(0, width=4, height=3)
        moving = fig.add_subplot(projection="polar").plot(x, x / 6)
    elif kind == "quiver":
        moving = [
            axes.quiver(*np.meshgrid(x[::40], x[::40]), *rng.normal(size=(2, 5, 5)), color="C2")
        ]
    elif kind == "log":
        moving = axes.loglog(10.0**x, 10.0 ** (x / 2), "s-.")
    elif kind == "fill":
        moving = [
            axes.fill_between(x, np.sin(x), 0, color="C3", alpha=0.3),
            axes.axvspan(2, 3, color="C4", alpha=0.2),
        ]
    else:
        moving = [axes.pcolormesh(rng.uniform(size=(6, 8)))]
    same(Picture(fig, *moving), mean=0.12, far=0.002)
    same(Picture(fig), mean=0.12, far=0.002)  # as still parts


def test_a_thousand_strokes_are_one_message_and_simplified():
    fig = figure(width=4, height=3)
    t = np.linspace(0, 1, 20_000)
    (line,) = fig.axes[0].plot(t, np.sin(6 * t))
    _, buffers = Scene(Picture(fig, line)).picture()
    line.set_visible(False)
    _, still = Scene(Picture(fig)).picture()
    assert len(buffers[0]) - len(still[0]) < 8 * 400  # 20 000 points on 300 pixels


def test_points_far_outside_are_cut_off():
    fig = figure(width=4, height=3)
    axes = fig.axes[0]
    axes.set(xlim=(0, 1), ylim=(0, 1))
    moving = axes.plot([-1e9, 0.5, 1e9, np.inf, np.nan, 0.5], [0.1, 0.5, 0.9, 0, 0, 1e12])
    message, buffers = Scene(Picture(fig, *moving)).picture()
    points = np.frombuffer(buffers[0], "<f4").reshape(-1, 2)
    assert np.nanmax(np.abs(points)) < 1000
    same(Picture(fig, *moving))


def test_only_changed_artists_are_drawn_again_and_agg_in_between_does_not_matter():
    fig = figure(width=4, height=3)
    one, two = (fig.axes[0].plot([0, 1], [0, k])[0] for k in (1, 2))
    scene = Scene(Picture(fig, one, two))
    first, _ = scene.picture()
    assert first["order"] == ["s0", "m0", "m1", "s1"] or first["order"][0] == "s0"
    assert scene.picture()[0]["ops"] == {}
    two.set_data([0, 1], [0, 1.5])
    fig.png()  # draws all artists, which are not stale after that
    message, _ = scene.picture()
    assert "m1" in message["ops"]
    two.set_data([0, 1], [0, 1.2])
    message, _ = scene.picture()
    assert set(message["ops"]) == {"m1"} and "order" not in message
    fig.axes[0].set_ylim(0, 3)
    assert set(scene.picture()[0]["ops"]) == set(first["ops"])
    fig.axes[0].set_title("a title")
    assert "s0" in scene.picture()[0]["ops"] and "s0" in scene.picture(everything=True)[0]["ops"]


def test_still_artists_stay_above_moving_ones():
    fig = figure(width=4, height=3)
    axes = fig.axes[0]
    moving = axes.plot([0, 1], [0.5, 0.5], linewidth=30, zorder=2, color="k")
    axes.add_patch(Rectangle((0.3, 0), 0.4, 1, facecolor="#D55E00", zorder=4))
    message, buffers = Scene(Picture(fig, *moving)).picture()
    picture = replayed(message, buffers)
    assert tuple(picture[picture.shape[0] // 2, int(axes.bbox.x0 + axes.bbox.width / 2)]) == (
        213,
        94,
        0,
    )


def test_the_fallback_is_the_same_picture():
    view = time_plot(simulate(ball(), 5.0), "y")
    scene = Scene(view)
    scene.picture(2.0)
    image = np.asarray(Image.open(io.BytesIO(scene.bitmap()))).astype(int)
    assert np.abs(image - drawn(view.figure)).mean() < 2
    assert "s0" in scene.picture(2.0)[0]["ops"]


def test_axes_that_stay_while_others_are_zoomed_are_not_drawn_again(monkeypatch):
    run, fig = simulate(ball(), 5.0), figure(1, 2, width=8, height=3)
    views = [
        time_plot(run, "y", axes=fig.axes[0]),
        phase_portrait(run, axes=fig.axes[1], limits=((0, 12), (-15, 15))),
    ]
    scene, drawn_axes, draw = Scene(Together(*views)), [], type(fig.axes[0]).draw
    scene.picture()
    monkeypatch.setattr(
        type(fig.axes[0]),
        "draw",
        lambda axes, renderer: (drawn_axes.append(fig.axes.index(axes)), draw(axes, renderer))[1],
    )
    for zoomed in (1, 0, 1):
        drawn_axes.clear()
        fig.axes[zoomed].set_ylim(-8 - zoomed, 9)
        views[1].update(run)
        message, buffers = scene.picture(settled=False)
        assert drawn_axes == [zoomed] and "order" in message
        scene.drawn = {}
        scene.forget()
        again, whole = scene.picture(settled=False)
        assert drawn_axes == [zoomed, 0, 1] and message == again and buffers == whole


def test_heads_of_trajectories_are_sent_with_the_curve():
    """Also those that follow it: Matplotlib's set_path does not say that a patch has changed."""
    run = simulate(ball(), 3.0, backend="plain")
    view = phase_portrait(run, limits=((0, 12), (-15, 15)))
    scene = Scene(view)
    scene.picture(everything=True)
    heads = next(part.heads for part in view.layers if hasattr(part, "heads"))
    view.update(run.again(start={"y": 5.0}))
    message, _ = scene.picture()
    sent = set(message["ops"])
    names = {f"m{view.artists.index(head)}" for head in heads if len(head.get_path().vertices)}
    assert names and names <= sent
