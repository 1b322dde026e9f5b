"""Figures that are curves: bias over shift, response on the star, profiles of a wave, errors of affine motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from public_cases.run import CaseResult
from public_cases.star import ATTENUATED, PERIODS
from sixflow.drawing.look import FONT, INK, new_figure

WIDTH = 7.6  # inches
OURS = ("#1b3a57", "#2f7f79", "#c98a2b", "#a23b3b", "#6a4c93", "#4d7c0f", "#d4699e", "#3aa6dd")
PEERS = ("#8a8a8a", "#b08d57", "#6f9bc8", "#9b86bd", "#86b886", "#cf8792")
PEER_LINES = ("--", ":", "-.", (0, (5, 1)), (0, (1, 1)), (0, (3, 1, 1, 1)))
PEER_MARKERS = "xs+dv^"


def styles(ours: tuple[str, ...], peers: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Return the look of every method's line: ours full, peers pale and broken."""
    coloured = {
        name: {"color": OURS[k % len(OURS)], "linewidth": 1.3, "zorder": 3} for k, name in enumerate(ours)
    }
    pale: dict[str, dict[str, Any]] = {
        name: {"color": PEERS[k % len(PEERS)], "linewidth": 0.9, "linestyle": PEER_LINES[k % len(PEER_LINES)]}
        for k, name in enumerate(peers)
    }
    return coloured | pale


def draw_bias(results: list[CaseResult], ours: tuple[str, ...], peers: tuple[str, ...]) -> Figure:
    """Bias of u and v over the sub-pixel shift."""
    results = sorted(results, key=lambda result: float(result.case.truth.u[0, 0]))
    shift = [float(result.case.truth.u[0, 0]) for result in results]
    figure = new_figure(WIDTH, 2.7)
    for ax, component in zip(figure.subplots(1, 2, sharey=True), "uv", strict=True):
        for name, style in styles(ours, peers).items():
            values = [
                getattr(result.entries[name].scores, f"bias_{component}")
                if name in result.entries
                else np.nan
                for result in results
            ]
            if np.isfinite(values).any():
                ax.plot(shift, values, marker=".", markersize=3.5, label=name, **style)
        ax.axhline(0, color=INK, linewidth=0.5)
        _dress(ax, f"bias of {component}", "true shift (px)", "mean error (px)" if component == "u" else "")
        ax.set_ylim(-0.06, 0.06)
    _legend(figure)
    return figure


def draw_star(results: list[CaseResult], ours: tuple[str, ...], peers: tuple[str, ...]) -> Figure:
    """Response over period of the displacement and of its derivative."""
    figure = new_figure(WIDTH, 3.0)
    entries = results[0].entries
    more = tuple(name for name in entries if name not in (*ours, *peers))
    for k, (ax, title) in enumerate(
        zip(figure.subplots(1, 2, sharey=True), ("displacement v", "gradient v_y"), strict=True)
    ):
        for name, style in styles((*ours, *more), peers).items():
            pair = entries[name].star if name in entries else None
            if pair is not None:
                ax.semilogx(PERIODS, pair[k].response, label=name, **style)
        ax.axhline(ATTENUATED, color=INK, linewidth=0.5, linestyle=":")
        ax.set_xticks([20, 30, 50, 100, 200], labels=["20", "30", "50", "100", "200"])
        ax.minorticks_off()
        _dress(ax, title, "period (px)", "response" if k == 0 else "")
        ax.set(xlim=(PERIODS[0], PERIODS[-1]), ylim=(-0.05, 1.08))
    _legend(figure)
    return figure


def draw_profiles(results: list[CaseResult], ours: tuple[str, ...], peers: tuple[str, ...]) -> Figure:
    """Mean over the rows of the error of u, along the frame."""
    figure = new_figure(WIDTH, 1.25 * len(results) + 0.6)
    axes = np.atleast_1d(figure.subplots(len(results), 1, sharex=True))
    for ax, result in zip(axes, results, strict=True):
        for name, style in styles(ours, peers).items():
            if name not in result.entries:
                continue
            measured = result.entries[name].comparison.measured
            error = result.entries[name].comparison.difference[0]
            known = np.isfinite(error)
            mean = np.where(known, error, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
            ax.plot(measured.x, mean, label=name, **style)
        ax.axhline(0, color=INK, linewidth=0.5)
        ax.set(ylim=(-0.035, 0.035), xlim=(0, result.case.truth.shape[1]))
        last = ax is axes[-1]
        _dress(ax, result.case.name, "x (px)" if last else "", "mean error of u (px)")
    _legend(figure)
    return figure


def draw_errors(results: list[CaseResult], ours: tuple[str, ...], peers: tuple[str, ...]) -> Figure:
    """Rms errors of displacement and gradient, complete windows, one dot per case and method."""
    figure = new_figure(WIDTH, 0.2 * len(results) + 1.1)
    names = [result.case.name.removeprefix(result.case.set_name + "/") for result in results]
    quantities = (
        ("displacement, rms error (px)", "rms_complete"),
        ("gradient, rms error", "gradient_complete"),
    )
    for ax, (label, quantity) in zip(figure.subplots(1, 2, sharey=True), quantities, strict=True):
        for name, style in styles(ours, peers).items():
            values = [
                getattr(result.entries[name].scores, quantity) if name in result.entries else np.nan
                for result in results
            ]
            if not np.isfinite(values).any():
                continue
            peer = name in peers
            marker = PEER_MARKERS[peers.index(name) % len(PEER_MARKERS)] if peer else "o"
            look = {"marker": marker, "markersize": 3.5, "color": style["color"], "zorder": 2 if peer else 3}
            ax.semilogx(values, range(len(results)), linestyle="none", label=name, **look)
        ax.set_yticks(range(len(names)), labels=names)
        ax.set_ylim(len(names) - 0.5, -0.5)
        _dress(ax, "", label, "")
        ax.grid(True, axis="y", linewidth=0.3, color="#dddddd")
        ax.minorticks_off()
    _legend(figure)
    return figure


def _dress(ax: Axes, title: str, x_label: str, y_label: str) -> None:
    ax.set_title(title, fontsize=FONT + 1, color=INK, pad=4, loc="left")
    ax.set_xlabel(x_label, fontsize=FONT, color=INK, labelpad=2)
    ax.set_ylabel(y_label, fontsize=FONT, color=INK, labelpad=2)
    ax.tick_params(labelsize=FONT, width=0.5, length=2.5, color=INK, labelcolor=INK)
    ax.spines[["top", "right"]].set_visible(False)
    for spine in ax.spines.values():
        spine.set_linewidth(0.5)


def _legend(figure: Figure) -> None:
    entries: dict[str, Any] = {}
    for ax in figure.axes:
        handles, labels = ax.get_legend_handles_labels()
        entries |= {
            label: handle for label, handle in zip(labels, handles, strict=True) if label not in entries
        }
    figure.legend(
        entries.values(), entries.keys(), loc="outside lower center", ncols=min(5, len(entries)), fontsize=FONT,
        frameon=False, labelcolor=INK,
    )  # fmt: skip
