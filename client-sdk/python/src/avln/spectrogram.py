"""Spectrograms in the SoundSpaces format."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

N_FFT, HOP, WINDOW, POOL = 512, 160, 400, 4
Padding = Literal["reflect", "constant"]


def spectrogram(audio: NDArray[np.float32], padding: Padding = "reflect") -> NDArray[np.float32]:
    """Returns the spectrogram of both ears, f32 [65, frames / 4, 2], like the SoundSpaces sensor.

    Frames of 512 samples every 160 samples, a Hann window of 400, Fourier magnitudes averaged in
    blocks of 4 frequencies by 4 frames (padded with zeros), then `log(1 + x)`. 16000 samples
    result in 65 x 26.

    Args:
        audio: samples, [2, n], n above 256.
        padding: `reflect` as in librosa before 0.10, or `constant` (zeros) as in later versions. Use the value from the
            agent's training.
    """
    return np.stack([np.log1p(_pooled(_magnitudes(ear, padding))) for ear in audio], axis=-1).astype(np.float32)


def _window() -> NDArray[np.float64]:
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(WINDOW) / WINDOW)
    side = (N_FFT - WINDOW) // 2
    return np.pad(hann, side)


def _magnitudes(samples: NDArray[np.float32], padding: Padding) -> NDArray[np.float64]:
    """Returns magnitudes, [frequencies, frames]."""
    padded = np.pad(samples.astype(np.float64), N_FFT // 2, mode=padding)
    starts = np.arange(0, len(padded) - N_FFT + 1, HOP)
    frames = padded[starts[:, None] + np.arange(N_FFT)]
    return np.abs(np.fft.rfft(frames * _window(), axis=1)).T


def _pooled(magnitudes: NDArray[np.float64]) -> NDArray[np.float64]:
    filled = np.pad(magnitudes, [(0, -size % POOL) for size in magnitudes.shape])
    rows, columns = (size // POOL for size in filled.shape)
    means: NDArray[np.float64] = filled.reshape(rows, POOL, columns, POOL).mean(axis=(1, 3))
    return means
