"""Impulse responses of a plant from runs in the same wind with and without inputs, by least squares."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import fftconvolve

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["explained_share", "identify", "respond"]


def respond(responses: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outputs (n_out, n + 1) of inputs (n_in, n): output k follows from inputs 0 … k - 1.

    Parameters
    ----------
    responses : numpy.ndarray, shape (n_out, n_in, n_taps)
        Entry l is what an input of one does to the output l + 1 steps later.
    inputs : numpy.ndarray, shape (n_in, n)
    """
    n = inputs.shape[1]
    out = np.zeros((responses.shape[0], n + 1))
    for j, series in enumerate(inputs):
        out[:, 1:] += fftconvolve(responses[:, j], series[None], axes=1)[:, :n]
    return out


def _delayed(inputs: NDArray[np.float64], taps: int) -> NDArray[np.float64]:
    """Regressors (n, n_in * taps) of outputs 1 … n."""
    n = inputs.shape[1]
    padded = np.pad(inputs, ((0, 0), (taps - 1, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, taps, axis=1)[:, :n, ::-1]
    return windows.transpose(1, 0, 2).reshape(n, -1)


def identify(
    inputs: Sequence[NDArray[np.float64]],
    changes: Sequence[NDArray[np.float64]],
    taps: int,
    ridge: float = 0.0,
    decay: float = 0.0,
) -> NDArray[np.float64]:
    """Fit finite impulse responses to the changes of outputs by inputs.

    Without a ridge, responses that end within the taps and outputs without noise are found exactly. The ridge is
    heavier for later taps: a plant forgets (Chen, Ohlsson and Ljung, Automatica 48 (2012) 1525: diagonal kernel).

    Parameters
    ----------
    inputs : sequence of numpy.ndarray, shape (n_in, n)
        Of each run.
    changes : sequence of numpy.ndarray, shape (n_out, n + 1)
        Outputs with the inputs minus those without, in the same wind.
    taps : int
    ridge : float
        Over the mean square of the inputs, summed over the samples.
    decay : float
        Logarithm of the ridge's rise over the taps.

    Returns
    -------
    numpy.ndarray, shape (n_out, n_in, taps)
        As of `respond`.

    Raises
    ------
    ValueError
        If shapes do not fit, nothing is finite, there are fewer samples than unknowns, or an input never moves.
    """
    if not inputs or len(inputs) != len(changes):
        raise ValueError(f"there must be as many runs of inputs as of changes, got {len(inputs)} and {len(changes)}")
    n_in, n_out = inputs[0].shape[0], changes[0].shape[0]
    for given, changed in zip(inputs, changes, strict=True):
        if given.shape[0] != n_in or changed.shape != (n_out, given.shape[1] + 1):
            raise ValueError(
                f"inputs (n_in, n) must come with changes (n_out, n + 1), got {given.shape} and {changed.shape}"
            )
        if not (np.isfinite(given).all() and np.isfinite(changed).all()):
            raise ValueError("inputs and changes must be finite")
    samples = sum(given.shape[1] for given in inputs)
    if taps < 1 or samples < n_in * taps:
        raise ValueError(
            f"{n_in} inputs with {taps} taps need at least {n_in * max(taps, 1)} samples and a tap; got {samples}"
        )
    gram, right = np.zeros((n_in * taps, n_in * taps)), np.zeros((n_in * taps, n_out))
    for given, changed in zip(inputs, changes, strict=True):
        rows = _delayed(given, taps)
        gram += rows.T @ rows
        right += rows.T @ changed[:, 1:].T
    still = [j for j in range(n_in) if gram[j * taps, j * taps] == 0.0]
    if still:
        raise ValueError(f"every input must move in some run; {', '.join(map(str, still))} do not")
    heavier = np.exp(decay * np.arange(taps) / taps)
    gram[np.diag_indices_from(gram)] += ridge * np.repeat(np.diag(gram)[::taps], taps) * np.tile(heavier, n_in)
    solved: NDArray[np.float64] = np.linalg.solve(gram, right)
    return solved.T.reshape(n_out, n_in, taps)


def explained_share(
    responses: NDArray[np.float64],
    inputs: Sequence[NDArray[np.float64]],
    changes: Sequence[NDArray[np.float64]],
    skip: int = 0,
) -> NDArray[np.float64]:
    """Share of the mean square of changes that responses explain (n_out,), one for a perfect model.

    Parameters
    ----------
    responses, inputs, changes
        As of `identify`; of runs that the responses were not fitted to, it says what they are worth.
    skip : int
        Samples left out at the start of every run.
    """
    left = [c[:, skip:] - respond(responses, u)[:, skip:] for u, c in zip(inputs, changes, strict=True)]
    whole = sum((c[:, skip:] ** 2).sum(1) for c in changes)
    share: NDArray[np.float64] = 1.0 - sum((e**2).sum(1) for e in left) / whole
    return share
