"""Quantisers of videos: what a lossy codec leaves in the pixels, grey values, as its decoder tells.

Decoders export the quantiser block by block. From its steps q, of the transform's coefficients in grey values, and the
frame follows the error of a pixel as it does for a JPEG (`jpeg.quantisation_noise`), with q for every frequency: the
transforms are close to the DCT. Of textured recordings it is 0.65 to 2 times the true error, of VP9 at low quality 3.5.

| codec | q |
|---|---|
| H.264 | 0.625·2^(qp/6) (ITU-T H.264, 8.5.9) |
| MPEG-1, 2 | qp·W/16, qp the quantiser scale, W the default matrix of intra blocks (H.262, 6.3.11) |
| MPEG-4, H.263 | 2·qp |
| VP9 | a/8, a the table of AC steps at qp (VP9 bitstream specification, 8.6.1) |

Of other codecs the quantiser is not known: their noise is 0, which says so.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from sixflow.frames.compression import is_reversible
from sixflow.frames.decoder import decoded, opened, video_stream
from sixflow.frames.jpeg import luma_steps, quantisation_noise
from sixflow.frames.metadata import Compression
from sixflow.frames.packets import Packets
from sixflow.frames.planes import luma_of

_SAMPLE = 8
"""Frames from which the quantiser is estimated."""

_NAMES = {
    "h264": "H.264",
    "hevc": "HEVC",
    "mjpeg": "motion JPEG",
    "mpeg4": "MPEG-4",
    "mpeg2video": "MPEG-2",
    "vp8": "VP8",
    "vp9": "VP9",
    "av1": "AV1",
    "libdav1d": "AV1",
    "prores": "ProRes",
    "jpeg2000": "JPEG 2000",
}

_WEIGHTED = ("mpeg1video", "mpeg2video")

_INTRA = np.array(
    [
        [8, 16, 19, 22, 26, 27, 29, 34],
        [16, 16, 22, 24, 27, 29, 34, 37],
        [19, 22, 26, 27, 29, 34, 34, 38],
        [22, 22, 26, 27, 29, 34, 37, 40],
        [22, 26, 27, 29, 32, 35, 40, 48],
        [26, 27, 29, 32, 35, 40, 48, 58],
        [26, 27, 29, 34, 38, 46, 56, 69],
        [27, 29, 35, 38, 46, 56, 69, 83],
    ]
)

_VP9_INDEX = (0, 1, 95, 126, 143, 161, 180, 200, 220, 240, 255)
_VP9_STEP = (4, 8, 102, 164, 227, 311, 440, 651, 951, 1396, 1828)


def step_of_quantiser(codec: str, qp: float) -> float:
    """Return the step of a video codec's quantiser, grey values of 8 bits; 0 where it is unknown.

    Parameters
    ----------
    codec : str
        Name of FFmpeg's decoder.
    qp : float
        Quantisation parameter as the decoder exports it.

    Examples
    --------
    >>> round(step_of_quantiser("h264", 28), 1)
    15.9
    """
    if codec == "h264":
        return 0.625 * 2.0 ** (qp / 6)
    if codec in _WEIGHTED:
        return qp
    if codec in ("mpeg4", "h263", "msmpeg4v1", "msmpeg4v2", "msmpeg4v3", "wmv1", "wmv2", "flv"):
        return 2 * qp
    if codec == "vp9":
        return float(np.interp(qp, _VP9_INDEX, _VP9_STEP)) / 8
    return 0.0


def noise_of_frame(frame: Any, codec: str) -> float | None:
    """Return the standard deviation that a decoded frame's quantiser leaves, in its grey values; None if unknown.

    Parameters
    ----------
    frame : av.VideoFrame
        Decoded with ``export_side_data=venc_params``.
    codec : str
    """
    for data in frame.side_data:
        if not hasattr(data, "qp"):
            continue
        count = min(data.nb_blocks, 4096)
        qps = [data.qp + data.block_params(k).delta_qp for k in range(count)] or [data.qp]
        step = math.sqrt(float(np.mean([step_of_quantiser(codec, qp) ** 2 for qp in qps])))
        if codec != "h264":  # whose qp counts the bits above 8
            step *= 2.0 ** (frame.format.components[0].bits - 8)
        if step:
            weights = _INTRA / 16 if codec in _WEIGHTED else np.ones((8, 8))
            return quantisation_noise(luma_of(frame)[0], step * weights)
    return None


def compression_of_video(path: Path, packets: Packets) -> Compression | None:
    """Return the lossy compression of a video, from its first frames; None where no bit was lost.

    Parameters
    ----------
    path : Path
    packets : Packets
        Of this file.
    """
    with opened(path) as container:
        stream = video_stream(container, path)
        codec, profile = stream.codec_context.codec, str(stream.codec_context.profile or "")
        data = b""
        if packets.codec in ("mjpeg", "jpeg2000"):
            data = next((bytes(packet) for packet in container.demux(stream) if packet.size), b"")
    steps = luma_steps(data) if packets.codec == "mjpeg" else None
    is_lossless = packets.codec == "mjpeg" and steps is None
    if not codec.lossy or is_lossless or (packets.codec == "jpeg2000" and is_reversible(data)):
        return None
    frames = (frame for _, frame, _ in decoded(path, packets.in_order[:_SAMPLE]) if frame is not None)
    sample = list(itertools.islice(frames, _SAMPLE))
    name = _NAMES.get(packets.codec, packets.codec)
    if steps is not None and sample:
        return Compression(name, quantisation_noise(luma_of(sample[0])[0], steps))
    noises = [noise_of_frame(frame, packets.codec) for frame in sample]
    known = [noise for noise in noises if noise is not None]
    if packets.codec == "h264" and known and max(known) < 0.25 and profile.startswith("High 4:4:4"):
        return None  # its lossless mode
    noise = math.sqrt(float(np.mean(np.square(known)))) if known else 0.0
    return Compression(name, noise, copies=not packets.intra_only)
