"""Zarr: plain arrays, and OME-Zarr images (0.4 and 0.5), read frame by frame.

Of the resolutions of an OME-Zarr image the finest is taken, with its axes, its pixel size and its frame interval. Next
Generation File Formats, https://ngff.openmicroscopy.org.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from sixflow.frames.arrayfile import ArrayFile, NotARecordingError, is_frames
from sixflow.frames.labelled import Labelled, codes_of_names, codes_of_shape
from sixflow.frames.metadata import Metadata
from sixflow.frames.units import length, seconds_in

_MOST = 1000
"""Arrays and groups that are looked at."""


@dataclasses.dataclass(frozen=True)
class _Found:
    """An array, and the OME metadata that describe it."""

    array: Any
    multiscale: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    channels: tuple[str, ...] = ()


class ZarrFile(ArrayFile):
    """An array of a Zarr store, or an image of an OME-Zarr."""

    @contextlib.contextmanager
    def _arrays(self) -> Iterator[Mapping[str, Any]]:
        import zarr

        store: Any = zarr.open(str(self.path), mode="r")
        if "sixflow_version" in store.attrs:
            raise NotARecordingError(self.path)
        found: dict[str, _Found] = {}
        _collect(store, "", found)
        wanted = self.selection.position
        if isinstance(wanted, str) and wanted.strip("/") not in found:
            found = _single(store, wanted.strip("/"), found) or found
        yield found

    def _label(self, array: Any, name: str) -> Labelled:
        data, stated = array.array, array.multiscale
        axes = [axis if isinstance(axis, dict) else {"name": str(axis)} for axis in stated.get("axes", ())]
        names = [str(axis.get("name", "")) for axis in axes] or _dimension_names(data)
        if len(names) != data.ndim:
            return Labelled(data, codes_of_shape(data.shape, name), chunks=data.chunks)
        codes = codes_of_names(names, data.shape, name)
        metadata = _metadata(codes, axes, _scales(stated)) if axes else Metadata()
        times = None
        return Labelled(data, codes, {"C": array.channels}, times, metadata, (), data.chunks)


def _collect(node: Any, path: str, found: dict[str, _Found]) -> None:
    """Find the images, and the arrays that belong to none."""
    if len(found) >= _MOST:
        return
    if hasattr(node, "shape"):
        if is_frames(node.shape, node.dtype):
            found[path or "array"] = _Found(node)
        return
    attrs = dict(node.attrs)
    ome = attrs.get("ome", attrs)
    scales = ome.get("multiscales") if isinstance(ome, dict) else None
    if isinstance(scales, list) and scales:
        level = str(scales[0]["datasets"][0]["path"])
        labels = (ome.get("omero") or {}).get("channels") or ()
        channels = tuple(str(channel.get("label", "")) for channel in labels)
        found[path or "image"] = _Found(node[level], scales[0], channels if all(channels) else ())
        return
    for name in sorted(node.keys()):
        if name not in ("labels", "OME"):
            _collect(node[name], f"{path}/{name}".lstrip("/"), found)


def _single(store: Any, path: str, images: Mapping[str, _Found]) -> dict[str, _Found] | None:
    """An array by its path, such as one resolution of an image; None where there is none."""
    try:
        array = store[path]
    except (KeyError, ValueError, TypeError, IndexError):
        return None
    if not hasattr(array, "shape"):
        return None
    for name, image in images.items():
        root = "" if name == "image" else f"{name}/"
        for level in image.multiscale.get("datasets", ()):
            if f"{root}{level.get('path')}" == path:
                return {path: _Found(array, {**image.multiscale, "datasets": [level]}, image.channels)}
    return {path: _Found(array)}


def _dimension_names(array: Any) -> list[str]:
    """Names that Zarr 3 or xarray give to the dimensions of an array."""
    names = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS") or ()
    return [str(name) for name in names] if all(names) else []


def _scales(stated: Mapping[str, Any]) -> list[float]:
    """Step along each axis: the scale of the finest resolution, times that of the image."""
    steps: list[float] = []
    for transforms in (
        stated["datasets"][0].get("coordinateTransformations", ()), stated.get("coordinateTransformations", ()),
    ):  # fmt: skip
        for transform in transforms or ():
            if transform.get("type") == "scale":
                scale = [float(value) for value in transform["scale"]]
                steps = [a * b for a, b in zip(steps, scale, strict=True)] if steps else scale
    return steps


def _metadata(codes: tuple[str, ...], axes: list[dict[str, Any]], steps: list[float]) -> Metadata:
    if len(steps) != len(codes):
        return Metadata()
    step, unit = (
        dict(zip(codes, steps, strict=True)),
        {c: a.get("unit") for c, a in zip(codes, axes, strict=True)},
    )
    seconds = seconds_in(unit.get("T")) if unit.get("T") else None
    interval = step["T"] * seconds if seconds is not None and step["T"] > 0 else None
    width, height = length(unit["X"]), length(unit["Y"])
    if width is None or step["X"] <= 0:
        return Metadata(frame_interval=interval)
    aspect = 1.0
    if height is not None and step["Y"] > 0:
        scale = 1.0 if height[0] == width[0] else height[1] / width[1]
        aspect = step["Y"] * scale / step["X"] if scale == scale else 1.0
    return Metadata(step["X"], width[0], interval, aspect)
