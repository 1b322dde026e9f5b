"""Are the operators near the Karhunen–Loève basis? (Eagleson, §5, after Watanabe.)

A patch is seen through the window of the least-squares fit, x = a·I with a = √w, w = exp(−r²/(2σ²)): energy and
information then carry the weight w, and an operator K of the bank, K = a·b, answers I with ⟨I, K⟩ = ⟨x, b⟩. The
brightness, I = constant, is no motion and is taken out of everything. Two ensembles over random textures:

    patches        x = a·I                          differences    d = a·(I(exp(Σ τ_k L_k) o) − I(o))

with random τ of which each moves the point at distance σ by the same rms, s. Each ensemble's KL basis are the
eigenvectors of its covariance, which is known: with ρ the correlation of the texture, δ = o' − o, a_k the field of L_k,

    E I(o)I(o') = ρ(δ),    E d(o)d(o') = −Σ_k s_k² a_k(o)ᵀ [∇∇ρ(δ)] a_k(o')      (to first order in τ),

for all six together s²(1 + 2 o·o'/σ²)(−Δρ). Of n orthonormal vectors Q, on rendered patches that nothing was fitted to:

    residual energy    1 − E|Qᵀx|²/E|x|²
    coding gain        arithmetic over geometric mean of the N coefficients' variances σ_j² + ν²: n of Q, while
                       the N − n others share the rest evenly; ν² is 1 % of the variance of a pixel
    information        [F⁻¹]_kk/[F_Q⁻¹]_kk, F = JᵀJ, F_Q = (QᵀJ)ᵀ(QᵀJ), J_k = a·L_k I: the share of what white noise on
                       the windowed patch leaves of the k-th number, all six unknown

Coding gain is defined for an orthonormal transform only. Kernels overlap: they are made orthonormal one after the
other, each time the one that captures most (`greedy`); or all at once, symmetrically, after Löwdin.

| symbol | name |
|---|---|
| a, and its direction | `Window.amplitude`, `Window.brightness` |
| ρ, ρ'/r, (ρ'' − ρ'/r)/r² | `Correlation.value`, `slope`, `bend`; ∇∇ρ = slope·I + bend·δδᵀ |
| Q, columns | `vectors` |
| J | `slopes` |
| s | `RMS`, px |
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cases import show
from operator_tables.karhunen_bases import (
    COUNTS,
    FAMILIES,
    RMS,
    SIDE,
    SIGMA,
    SIZE,
    WINDOW,
    Correlation,
    Window,
    all_bases,
    angular_orders,
    band_correlation,
    bank_vectors,
    blob_correlation,
    coding_gain,
    cramer_rao_variances,
    difference_covariance,
    greedy,
    in_cosines,
    information,
    karhunen_loeve,
    make_window,
    one_order_each,
    patch_covariance,
    residual_energy,
    seen_variances,
    variances,
)
from sixflow import convention, synth
from sixflow.convention import SIX
from sixflow.drawing.look import FONT, INK, SIGNED_MAP, new_figure, tidy
from sixflow.eigenfilters import default_bank
from sixflow.eigenfilters.generators import as_generator

Array: TypeAlias = NDArray[np.float64]

CURVES = {
    "KL": (INK, "-"),
    "windowed cosines": ("#2f7f79", "-"),
    "bank": ("#a23b3b", "-"),
    "54 Gabors": ("#a23b3b", ":"),
    "DCT, best": ("#c98a2b", "-"),
    "random": ("#9a9a9a", "-"),
}
GENERATED: dict[str, Sequence[str]] = {
    "rotation": ("curl",),
    "zoom": ("divergence",),
    "translation": ("u", "v"),
    "both shears": ("stretch", "shear"),
    "stretch alone": ("stretch",),
    "all six": SIX,
}


class Kind(NamedTuple):
    """A kind of texture: one for each seed, and the correlation of all."""

    make: Callable[[int], synth.Pattern]
    correlation: Correlation


class Ensemble(NamedTuple):
    """Rendered grey values: patches and differences (m, N), and L_k I (m, 6, N) per unit of the six."""

    patches: Array
    differences: Array
    slopes: Array


def kinds() -> dict[str, Kind]:
    """The textures of the other benchmarks."""
    return {
        "speckle": Kind(lambda seed: synth.Speckle(sigma=2, seed=seed), blob_correlation(2.0)),
        "particles": Kind(lambda seed: synth.Particles(diameter=4, seed=seed), blob_correlation(1.0)),
        "texture": Kind(lambda seed: synth.Texture(seed=seed), band_correlation(6.0, 24.0)),
    }


def draw(kind: Kind, window: Window, count: int, first: int, *, slopes: bool) -> Ensemble:
    """Render `count` textures of the seeds from `first` on, before and after a random deformation each."""
    x, y = window.x, window.y
    spread = RMS * np.array([1, 1, *[2 / SIGMA] * 4])  # divergence = 2τ_s …
    rng = np.random.default_rng(first)
    patches, differences = np.empty((2, count, SIZE))
    gradients = np.empty((count if slopes else 0, 6, SIZE))
    for k in range(count):
        pattern = kind.make(first + k)
        six = convention.exp_six(spread * rng.normal(size=6))
        moved = convention.transform_points(six, np.stack([x, y], axis=-1))
        patches[k] = pattern(x, y)
        differences[k] = pattern(moved[:, 0], moved[:, 1]) - patches[k]
        if slopes:
            both = pattern.gradient(x, y)
            gradients[k] = [as_generator(name).apply(*both, x, y) for name in SIX]
            gradients[k, 2:] /= 2
    return Ensemble(patches, differences, gradients)


def table(quick: bool = False, folder: Path | None = None) -> None:
    """Print the tables; draw `karhunen.png` into the folder if one is given.

    Parameters
    ----------
    quick : bool
        Speckle only, from fewer patches.
    folder : Path or None
        Where the picture goes.
    """
    window, count = make_window(), (200, 60) if quick else (600, 240)
    for name, kind in kinds().items():
        fitted = draw(kind, window, count[0], 10_000, slopes=False)
        unseen = draw(kind, window, count[1], 500_000, slopes=True)
        if not quick:
            covariance = patch_covariance(window, kind.correlation)
            _compare(f"{name}, patches", window, covariance, fitted.patches, unseen.patches, unseen)
        covariance = difference_covariance(window, kind.correlation)
        title = f"{name}, differences"
        bases = _compare(title, window, covariance, fitted.differences, unseen.differences, unseen)
        if name == "speckle":
            _each_number(bases, window.see(unseen.slopes))
            _by_generator(kind, window, tuple(GENERATED)[: 1 if quick else None])
            if folder is not None:
                _draw_figure(Path(folder) / "karhunen.png", kind, window, bases, unseen)
            if quick:
                return
            window_w, title = make_window(1.0), f"{title}, weight w"
            covariance = difference_covariance(window_w, kind.correlation)
            _compare(title, window_w, covariance, fitted.differences, unseen.differences, unseen)


def _compare(
    title: str, window: Window, covariance: Array, fitted: Array, samples: Array, unseen: Ensemble
) -> dict[str, Array]:
    """Every measure of every basis; the bases."""
    samples, slopes = window.see(samples), window.see(unseen.slopes)
    noise = 0.01 * float(np.square(samples).sum(axis=1).mean() / np.square(window.amplitude).sum())
    bases = all_bases(covariance, window, window.see(fitted))
    best, rows, misfit = residual_energy(bases["KL"], samples), [], 0.0
    for basis, vectors in bases.items():
        counts = [n for n in COUNTS if n <= vectors.shape[1]]
        residual, gain = residual_energy(vectors, samples), coding_gain(vectors, samples, noise)
        exact = 1 - np.cumsum(variances(covariance, vectors)) / np.trace(covariance)
        misfit = max(misfit, float(np.abs(exact - residual).max()))
        gaps = ["–"] * (len(COUNTS) - len(counts))
        cells = [f"{100 * residual[n - 1]:.1f}" for n in counts] + gaps
        cells += [f"{gain[n - 1]:.2f}" for n in counts] + gaps
        cells += [f"{100 * share:.1f}" for share in information(vectors, slopes, counts)] + gaps
        rows.append([basis, *cells, str(int((best > residual[-1]).sum() + 1))])
    header = [f"{letter} {n}" for letter in ("E", "G", "F") for n in COUNTS]
    show(
        f"{title}: residual energy E %, coding gain G dB, information F % of n kernels; as many KL vectors leave\n"
        f"the residual of all. (Residual energy by the known covariance and of rendered patches: within {misfit:.3f})",
        ["basis", *header, "= KL"],
        rows,
    )
    return bases


def _each_number(bases: dict[str, Array], slopes: Array) -> None:
    whole, counts, rows = cramer_rao_variances(slopes).mean(axis=0), (64, 108), []
    for basis in ("KL", "windowed cosines", "54 Gabors", "bank", "DCT, best"):
        for n, part in zip(counts, seen_variances(bases[basis], slopes, counts), strict=True):
            rows.append([f"{basis}, {n}", *np.sqrt(part.mean(axis=0) / whole)])
    show("speckle: rms standard error from n kernels, relative to the whole window", ["basis", *SIX], rows)


def _by_generator(kind: Kind, window: Window, cases: Sequence[str]) -> None:
    """Angular orders of the KL basis, and what each family leaves, where only some generators act."""
    rows, most = [], 32
    for label in cases:
        covariance = difference_covariance(window, kind.correlation, GENERATED[label])
        values, vectors = karhunen_loeve(in_cosines(covariance), 40)
        order, share = angular_orders(one_order_each(values, vectors, window)[:, :most])
        families = [*([family] for family in FAMILIES), FAMILIES]
        sets = [greedy(covariance, bank_vectors(window, several), most)[0] for several in families]
        captured = [variances(covariance, q).sum() / np.trace(covariance) for q in (vectors[:, :most], *sets)]
        left = [f"{100 * (1 - part):.1f}" for part in captured]
        rows.append([label, " ".join(map(str, order[:12])), f"{share.mean():.3f}", *left])
    header = ["angular orders of the first KL vectors", "purity", "E 32: KL", *FAMILIES, "bank"]
    show("speckle: differences that only some generators make", ["generators", *header], rows)


def _draw_figure(path: Path, kind: Kind, window: Window, bases: dict[str, Array], unseen: Ensemble) -> None:
    figure: Any = new_figure(7.6, 5.5)
    top, bottom = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    patches, differences, first = top.subplots(1, 3)
    covariance = difference_covariance(window, kind.correlation)
    for ax, name, matrix in (
        (patches, "patches", patch_covariance(window, kind.correlation)),
        (differences, "differences", covariance),
    ):
        vectors = one_order_each(*karhunen_loeve(in_cosines(matrix), 24), window)[:, :16]
        _draw_tiles(ax, f"KL basis of {name}", vectors, [str(order) for order in angular_orders(vectors)[0]])
    bank, kernels = bank_vectors(window), default_bank(WINDOW).kernels
    _, chosen = greedy(covariance, bank, 16)
    letters = [type(kernels[k % len(kernels)]).__name__[0] for k in chosen]
    _draw_tiles(first, "The bank's first choice for differences", bank[:, chosen], letters)
    left, right = bottom.subplots(1, 2)
    samples, slopes = window.see(unseen.differences), window.see(unseen.slopes)
    for basis, (colour, style) in CURVES.items():
        vectors, look = bases[basis], {"color": colour, "linestyle": style, "linewidth": 1.2, "label": basis}
        count = np.arange(1, vectors.shape[1] + 1)
        left.plot(count, 100 * residual_energy(vectors, samples), **look)
        right.plot(count[7::4], 100 * np.array(information(vectors, slopes, count[7::4].tolist())), **look)
    for ax, title in (
        (left, "Energy of differences that is left (%)"),
        (right, "Information on the six (%)"),
    ):
        tidy(ax, title=title, x_label="number of real kernels", y_label="")
        ax.set(xlim=(0, 110), ylim=(0, 100), xticks=range(0, 101, 20), yticks=range(0, 101, 25))
        ax.spines[["top", "right"]].set_visible(False)
    right.legend(frameon=False, fontsize=FONT, loc="upper left")
    figure.savefig(path, dpi=200)


def _draw_tiles(ax: Any, title: str, vectors: Array, marks: Sequence[str]) -> None:
    """Sixteen vectors, each on a scale of its own: blue negative, red positive."""
    pitch = SIDE + 4
    sheet = np.full((4 * pitch - 4, 4 * pitch - 4), np.nan)
    for index, (column, mark) in enumerate(zip(vectors.T, marks, strict=True)):
        row, place = pitch * (index // 4), pitch * (index % 4)
        sheet[row : row + SIDE, place : place + SIDE] = (column / np.abs(column).max()).reshape(SIDE, SIDE)
        ax.text(place + 2, row + 2, mark, fontsize=FONT - 1, color=INK, va="top")
    ax.imshow(sheet, cmap=SIGNED_MAP, vmin=-1, vmax=1, interpolation="nearest")
    ax.set_title(title, fontsize=FONT + 1, color=INK, loc="left", pad=4)
    ax.set_axis_off()
