"""What all frames of a recording have in common at the same pixels is estimated, and taken out on request."""

import numpy as np
import pytest

import measured
from sixflow import InputError, measure, measure_sequence
from sixflow.prepare.pattern import FixedPattern
from sixflow.synth import Affine, Sensor, Speckle, sequence

SHAPE = (128, 128)
RNG = np.random.default_rng(3)
PATTERNS = {
    "pixels": RNG.normal(0, 4, SHAPE),
    "columns": RNG.normal(0, 6, (1, SHAPE[1])) + np.zeros(SHAPE),
    "rows": RNG.normal(0, 6, (SHAPE[0], 1)) + np.zeros(SHAPE),
}
MOTION = Affine.translation(1.4, 0.8)


def recording(pattern, count=16, contrast=12):
    film = sequence(Speckle(seed=1, contrast=contrast), MOTION, SHAPE, count, sensor=Sensor(noise=0)).frames
    noise = np.random.default_rng(5).normal(0, 1, (count, *SHAPE))
    return np.clip(np.rint(film + pattern + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", PATTERNS)
def test_a_fixed_pattern_is_taken_out(name):
    frames = recording(PATTERNS[name])
    pattern = FixedPattern.of(frames, len(frames), SHAPE)
    true = PATTERNS[name] - PATTERNS[name].mean()
    # an eighth of the power of rows is in octaves of fewer than 16 frequencies; as much is hidden by the texture's mean
    assert ((pattern.grey - true) ** 2).mean() < 0.3 * (true**2).mean()
    plain, less = (
        measure_sequence(frames[:5] if not on else frames, window=31, step=16, fixed_pattern=on)
        for on in (False, True)
    )
    off = [float(np.hypot(field.u - 1.4, field.v - 0.8).isel(time=0).median()) for field in (plain, less)]
    assert off[1] < np.nan_to_num(off[0], nan=1.0) / 2  # NaN: most points failed
    assert "a fixed pattern of" in less.attrs["notes"]


def test_a_recording_without_a_pattern_stays_as_it_is():
    frames = recording(0.0)
    pattern = FixedPattern.of(frames, len(frames), SHAPE)
    # of the texture, 16 frames leave 1/16 of the power in their mean, which is uncorrelated between the halves
    assert pattern.size < 0.1 * 12
    with_, without = (measure_sequence(frames, window=31, step=16, fixed_pattern=on) for on in (True, False))
    error = measured.standard_errors(without.isel(time=[0]))[..., 0]
    difference = np.abs(with_.u.values[0] - without.u.values[0]) / error
    assert np.nanmedian(difference) < 0.5


def test_what_fixed_pattern_cannot_do():
    frames = recording(0.0, 4)
    with pytest.raises(InputError, match="fixed_pattern"):
        measure(frames[0], frames[1], fixed_pattern=True)
    with pytest.raises(InputError, match="fixed_pattern"):
        measure_sequence(frames[:3], fixed_pattern=True)
    with pytest.raises(InputError, match="read twice"):
        measure_sequence((frame for frame in frames), fixed_pattern=True)
    with pytest.raises(InputError, match="fixed_pattern"):
        measure_sequence(frames, fixed_pattern=1)
