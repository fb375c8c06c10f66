"""The compiled code of open-end soft-DTW: local distances, and the recursion of Algorithm 1.

All of it stands in one file, because numba's cache does not notice that a function in another file has
changed. No function uses ``fastmath``: inf is a legal cost, and every machine must give the same bits. The
inner loops of the distances run over the reference index, where cells are independent, so that they still
vectorise.
"""

import math

import numpy as np
from numba import njit

# Which distance: indices that compiled code can branch on.
EUCLIDEAN, SQEUCLIDEAN, WP = range(3)

# Beyond this size a square or a sum could overflow, and one infinite cost would spoil all later ones.
LARGEST = 1e100

# Steps per unit of a Windowed-Pearson distance: with a power of two, hard-minimum costs add without rounding.
_GRID = 2.0**40


@njit(cache=True)
def euclidean_row(sample, reference, squared, out):
    """Euclidean distances of one query sample to all reference samples.

    Args:
        sample: (d,) the query sample p_i.
        reference: (d, n) the reference q, one row per axis.
        squared: whether to leave out the square root.
        out: (n,) receives delta(p_i, q_j) for j = 0 .. n-1.
    """
    out[:] = 0.0
    for axis in range(reference.shape[0]):
        for j in range(reference.shape[1]):
            difference = sample[axis] - reference[axis, j]
            out[j] += difference * difference
    if not squared:
        for j in range(reference.shape[1]):
            out[j] = np.sqrt(out[j])


@njit(cache=True)
def normalize_window(samples, out):
    """Centres a window and scales it to unit length, so that a correlation is a dot product of two windows.

    A flat window, that is one whose samples are all equal, gives zeros: its correlation with anything is 0.
    The test for flatness is exact; a threshold on the variance would depend on offset, scale and rounding.

    Args:
        samples: (k,) the window on one axis.
        out: (k,) receives the normalised window.
    """
    largest = 0.0
    for a in range(samples.size):
        out[a] = samples[a] - samples[0]
        largest = max(largest, abs(out[a]))
    if largest == 0.0:
        return
    mean = 0.0
    for a in range(samples.size):
        out[a] /= largest
        mean += out[a]
    mean /= samples.size
    square = 0.0
    for a in range(samples.size):
        out[a] -= mean
        square += out[a] * out[a]
    norm = np.sqrt(square)
    for a in range(samples.size):
        out[a] /= norm


@njit(cache=True)
def normalized_windows(reference, window):
    """The normalised window that ends at each reference sample, cut to the samples there are.

    Args:
        reference: (d, n) the reference q, one row per axis.
        window: [samples] window length w.

    Returns:
        (d, w, n): entry [axis, :, j] is the window of min(w, j + 1) samples up to q_j, oldest first, with
        zeros before it.
    """
    num_axes, n = reference.shape
    windows = np.zeros((num_axes, window, n))
    for axis in range(num_axes):
        for j in range(n):
            k = min(window, j + 1)
            normalize_window(reference[axis, j + 1 - k : j + 1], windows[axis, window - k :, j])
    return windows


@njit(cache=True)
def _add_multiple(factor, values, out):
    for j in range(out.size):
        out[j] += factor * values[j]


@njit(cache=True)
def windowed_pearson_row(recent, num_recent, reference, windows, out):
    """Windowed-Pearson distances (Eq. 3) of the newest query sample to all reference samples.

    Differs from Eq. 3 where that is undefined: both windows are cut to the k = min(w, i + 1, j + 1) samples
    that exist; fewer than 2 samples, or a flat window on either side, count as correlation 0 (distance 1 on
    that axis). ``tests/dtw/test_kernels.py`` shows each case. The distance is rounded to 2^-40: sums of
    distances are then exact, and rounding cannot decide between equal costs, which are common (windows of 2
    samples correlate by +1 or -1 only).

    Args:
        recent: (d, w) the last query samples, oldest first, the newest in the last column.
        num_recent: how many columns at the end of `recent` hold samples.
        reference: (d, n) the reference q, one row per axis.
        windows: (d, w, n) from `normalized_windows(reference, w)`.
        out: (n,) receives delta(p_i, q_j) for j = 0 .. n-1.
    """
    num_axes, w, n = windows.shape
    k_query = min(w, num_recent)
    query_window = np.empty(w)
    reference_window = np.empty(w)
    # Columns before this one compare windows cut below w; all of them do while the query is that short.
    first_full = min(w - 1, n) if k_query == w else n
    out[:] = 0.0
    for axis in range(num_axes):
        for j in range(first_full):
            k = min(k_query, j + 1)
            if j < k_query:  # k has grown by one
                normalize_window(recent[axis, w - k :], query_window[:k])
            if k == j + 1:
                reference_window[:k] = windows[axis, w - k :, j]
            else:  # happens in the first w - 1 samples of a query only
                normalize_window(reference[axis, j + 1 - k : j + 1], reference_window[:k])
            correlation = 0.0
            for a in range(k):
                correlation += query_window[a] * reference_window[a]
            out[j] += correlation
        if k_query == w:
            normalize_window(recent[axis], query_window)
            for a in range(w):
                _add_multiple(query_window[a], windows[axis, a, first_full:], out[first_full:])
    for j in range(n):
        # Rounding also brings correlations of 1 + 1e-16 back to 1, so that no distance is negative.
        out[j] = np.rint((num_axes - out[j]) * _GRID) / _GRID


@njit(cache=True)
def in_range(values):
    """Whether all values of an array are finite and at most `LARGEST` in size."""
    ok = True
    for value in values.flat:
        ok = ok and abs(value) <= LARGEST  # false for NaN as well
    return ok


@njit(cache=True)
def soft_min(a, b, c, gamma):
    """min^gamma of three costs: a shifted log-sum-exp; the minimum for gamma = 0; infinite if all are."""
    smallest = min(a, b, c)
    if gamma == 0.0 or smallest == np.inf:
        return smallest
    total = math.exp((smallest - a) / gamma) + math.exp((smallest - b) / gamma) + math.exp((smallest - c) / gamma)
    return smallest - gamma * math.log(total)


@njit(cache=True)
def update(state, sample, reference, windows, distance, gamma):
    """Lines 4-6 of Algorithm 1 for one more query sample.

    Args:
        state: [number of samples, last w samples of each axis (WP only), R[i, 1..n]], changed in place; at
            first 0, anything finite, and infinities.
        sample: (d,) the query sample p_i.
        reference: (d, n) the reference q, one row per axis.
        windows: (d, w, n) from `normalized_windows(reference, w)`.
        distance: EUCLIDEAN, SQEUCLIDEAN or WP.
        gamma: smoothing of the minimum, >= 0.
    """
    num_axes, n = reference.shape
    first = state[0] == 0.0
    state[0] += 1.0
    cost = np.empty(n)
    if distance == WP:
        window = windows.shape[1]
        recent = state[1 : 1 + num_axes * window].reshape((num_axes, window))
        for axis in range(num_axes):
            for a in range(window - 1):
                recent[axis, a] = recent[axis, a + 1]
            recent[axis, window - 1] = sample[axis]
        windowed_pearson_row(recent, int(state[0]), reference, windows, cost)
    else:
        euclidean_row(sample, reference, distance == SQEUCLIDEAN, cost)
    row = state[state.size - n :]
    diagonal = 0.0 if first else np.inf  # R[i-1, 0]
    left = np.inf  # R[i, 0]
    for j in range(n):
        above = row[j]
        left = cost[j] + soft_min(above, left, diagonal, gamma)
        diagonal = above
        row[j] = left


@njit(cache=True)
def phases(state, query, reference, windows, distance, gamma, out):
    """Algorithm 1 for a query (m, d): `out` (m,) receives the phases, Eq. 2. The rest is as in `update`."""
    n = reference.shape[1]
    for i in range(query.shape[0]):
        update(state, query[i], reference, windows, distance, gamma)
        out[i] = np.argmin(state[state.size - n :]) / (n - 1)
