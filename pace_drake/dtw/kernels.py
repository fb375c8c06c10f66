"""The compiled code of open-end soft-DTW: local distances, and the recursion of Algorithm 1.

All of it stands in one file, because numba's cache does not notice that a function in another file has changed. No
function uses ``fastmath`` and none calls the C library's exp or log: every machine gives the same bits. Sums of
products are fused by name, never where a compiler sees fit.

One more query sample costs O(n d) for a reference (n, d), whatever the window, and allocates nothing:

- Windowed-Pearson: covariances of windows run along the diagonals of the cost matrix. While windows grow, a sample
  joins both (Welford); then one joins and one leaves both (the update of SCAMP, Zimmerman et al. 2019). Each
  covariance carries a bound of its rounding error, and is computed anew from its windows where that grows too large.
- Soft minimum: with E = exp(-R / gamma), line 6 of Algorithm 1 is linear, E[i, j] = exp(-delta / gamma) *
  (E[i-1, j] + E[i, j-1] + E[i-1, j-1]): one exp a cell, and no log. E is held as m * 2^(512 k) with m in
  [2^-256, 2^256), so that it never underflows.

Functions take whole arrays and places in them, and slice them inside: numba counts references to a slice that is
handed on, which takes longer than some of the loops. Loops over independent cells stand apart, so that they vectorise.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float64, int64, njit
from numba.extending import intrinsic
from numpy.typing import NDArray

# Settings, as indices that compiled code can branch on.
WP, EUCLIDEAN, SQEUCLIDEAN, DERIVATIVE = range(4)
SYMMETRIC1, SYMMETRIC2, ASYMMETRIC = range(3)
NONE, MAX, STEPS = range(3)

# Beyond this size a square or a sum could overflow, and one infinite cost would spoil all later ones.
LARGEST = 1e100

# The state vector: number of samples, phase, local costs (n,) of the last sample; then R[i, 1..n] for gamma = 0,
# else m, k, weights and their blocks, (n,) each; then what the distance remembers.
COUNT, PHASE, COST = range(3)
# Rows of covariances drift through their places by one a sample, so that they lie still along diagonals.
SLACK = 64

# Steps per unit of a Windowed-Pearson distance: with a power of two, hard-minimum costs add without rounding.
_GRID = 2.0**40
# A correlation whose error may be larger is computed directly.
_TOLERANCE = 1e-11
# Error of one step of a covariance, per product of the windows' norms; twice the largest that was measured.
_ROUNDING = 4.0 * 2.0**-53
# Smaller squares lose digits.
_SMALLEST = 2.0**-960

# exp(x) = 2^whole exp(r), |r| <= ln(2) / 2. ln 2 in two parts: whole times the first has no rounding error.
_LN2 = 0.6931471805599453
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
_PER_LN2 = 1.0 / _LN2
_C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9, _C10, _C11, _C12, _C13 = (1.0 / math.factorial(k) for k in range(2, 14))
# Added to a whole number, it brings that number into the lowest bits.
_TO_BITS = 1.5 * 2.0**52
_EXPONENT = 52  # the first bit of a float's exponent
_SQRT_HALF = int(np.array(math.sqrt(0.5)).view(np.int64))  # as bits

# Costs whose difference is below this, relative to their size, tie.
_TIE = 1e-12

_UP, _DOWN = 2.0**512, 2.0**-512
_LOW, _HIGH = 2.0**-256, 2.0**256


def _bits_of_float(_, x):
    return int64(float64), lambda context, builder, signature, args: builder.bitcast(args[0], ir.IntType(64))


def _float_of_bits(_, bits):
    return float64(int64), lambda context, builder, signature, args: builder.bitcast(args[0], ir.DoubleType())


def _fused(_, a, b, c):
    return float64(float64, float64, float64), lambda context, builder, signature, args: builder.fma(*args)


# The bits of a float64 as int64, and the float64 that has these bits.
_bits: Any = intrinsic(_bits_of_float)
_float: Any = intrinsic(_float_of_bits)
# a * b + c, rounded once; slow on a machine without such an instruction, but with the same bits.
_fma: Any = intrinsic(_fused)

# Division by zero gives inf or NaN, as in numpy: a check would keep loops from vectorising.
_compiled = njit(cache=True, nogil=True, error_model="numpy")
# For functions that only compiled code calls: nothing to call them by from Python needs to be compiled.
_bare: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_inner = njit(cache=True, nogil=True, error_model="numpy", **_bare)
# Of two functions on the way from `phases` to what it is made of: LLVM optimises all that a function calls anew with
# it, so that every level costs a second when the cache is empty.
_inlined = njit(cache=True, nogil=True, error_model="numpy", inline="always", **_bare)


def num_states(num_axes: int, n: int, window: int, distance: int, groups: int, gamma: float) -> int:
    """Length of the state vector; arguments as in `step`."""
    rows = COST + (2 if gamma == 0.0 else 5) * n
    if distance == WP:
        return rows + num_axes * (4 * window + 4) + groups * (window + 2 * (n + SLACK))
    return rows + (3 * num_axes if distance == DERIVATIVE else 0)


def initial_state(num_states: int, n: int, gamma: float) -> NDArray:
    """A state vector that has seen no sample: R[0, 1..n] is infinite, and so are the costs of the last sample."""
    state = np.zeros(num_states)
    state[COST : COST + n] = np.inf
    if gamma == 0.0:
        state[COST + n : COST + 2 * n] = np.inf
    else:
        state[COST + 2 * n : COST + 3 * n] = -np.inf  # the exponents of 0
    return state


# --- local distances ---


@_inner
def _euclidean_row(sample, reference, squared, state):
    """Euclidean distances of a sample (d,) to all reference samples (d, n)."""
    n = reference.shape[1]
    out = state[COST : COST + n]
    out[:] = 0.0
    for axis in range(reference.shape[0]):
        of_axis, value = reference[axis], sample[axis]
        for j in range(n):
            difference = value - of_axis[j]
            out[j] += difference * difference
    if not squared:
        for j in range(n):
            out[j] = np.sqrt(out[j])


@_inner
def _late_derivative(sample, state, at):
    """Writes the derivative (d,) of Keogh and Pazzani at the sample before this one; the action begins at rest.

    From `at` on, state holds it, the sample before this one and the one before that.
    """
    d = sample.size
    derivative, last, older = state[at : at + d], state[at + d : at + 2 * d], state[at + 2 * d :]
    for axis in range(d):
        if state[COUNT] == 0.0:
            last[axis] = older[axis] = sample[axis]
        derivative[axis] = ((last[axis] - older[axis]) + (sample[axis] - older[axis]) / 2.0) / 2.0
        older[axis], last[axis] = last[axis], sample[axis]


@_inner
def _slide(x, first, memory, at, w):
    """Moves the windows of one axis on to the sample x.

    The window of k + 1 samples that ends here is the window of k samples that ended one sample ago, and x (Welford).
    So no window ever loses a sample, and none loses digits. Means relative to the last sample stand any offset.

    Args:
        x: the new sample.
        first: whether there was none before.
        memory: holds, from `at` on, the last samples (w,), oldest first; mean (w + 1,) of the last 1, 2, .. w + 1
            samples, relative to the last one; square (w + 1,) sums of squared deviations in the same windows; rise
            (w + 1,) x minus the mean of the 0, 1, .. w samples before it; run, how many equal samples come last.
        at: begin.
        w: window.

    Returns:
        Half the difference of the sample that joins the window of w and the one that leaves it, and the sum of both,
        each relative to the mean of the window to which it belongs.
    """
    recent, mean = memory[at : at + w], memory[at + w : at + 2 * w + 1]
    square, rise = memory[at + 2 * w + 1 : at + 3 * w + 2], memory[at + 3 * w + 2 : at + 4 * w + 3]
    if first:
        recent[:] = x
    step = x - recent[w - 1]
    memory[at + 4 * w + 3] = memory[at + 4 * w + 3] + 1.0 if step == 0.0 else 1.0
    half = (x - recent[0]) / 2.0
    both = (recent[0] - recent[w - 1]) - mean[w - 1]
    for k in range(w, 0, -1):
        up = step - mean[k - 1]
        share = k / (k + 1.0)
        rise[k] = up
        mean[k] = -up * share
        square[k] = square[k - 1] + up * up * share
    for a in range(w - 1):
        recent[a] = recent[a + 1]
    recent[w - 1] = x
    return half, both - mean[w - 1]


@_inner
def _inverse_norms(memory, axis, size, w, at):
    """Writes the inverse norms (w,) of the last 1 .. w samples of `size` axes together, from `at` on.

    A flat window, whose samples are all equal, has 0, so that its correlation with anything is 0. Flatness is exact:
    a threshold on the variance would depend on offset, scale and rounding. A norm too small for squares has inf.

    Returns:
        The norm of the last w + 1 samples.
    """
    inverse = memory[at : at + w]
    inverse[:] = 0.0
    wide = 0.0
    flat = w
    for begin in range(axis * (4 * w + 4), (axis + size) * (4 * w + 4), 4 * w + 4):
        square = memory[begin + 2 * w + 1 : begin + 3 * w + 2]
        for k in range(w):
            inverse[k] += square[k]
        wide += square[w]
        flat = min(flat, int(memory[begin + 4 * w + 3]))
    for k in range(w):
        inverse[k] = 1.0 / np.sqrt(inverse[k] if inverse[k] >= _SMALLEST else 0.0)
    inverse[:flat] = 0.0
    return np.sqrt(wide)


def window_tables(reference, w, groups):
    """What `step` needs to know of the windows of the reference.

    Args:
        reference: (d, n) the reference q, one row per axis.
        w: [samples] the window, at most n.
        groups: g, number of correlations of a cell: d, or 1 where they are pooled.

    Returns:
        ahead: (d, w, n), q_j minus the mean of the min(k, j) + 1 samples up to it at [axis, k, j];
        inverse: (g, w, n), inverse norms of the same windows;
        rolling: (2, d, n), what `_slide` returns;
        wide: (g, n), norms of the windows of w + 1 samples.
    """
    d, n = reference.shape
    ahead, inverse = np.zeros((d, w, n)), np.zeros((groups, w, n))
    rolling, wide = np.zeros((2, d, n)), np.zeros((groups, n))
    _write_tables(reference, np.zeros(d * (4 * w + 4) + w), ahead, inverse, rolling, wide)
    return ahead, inverse, rolling, wide


@_compiled
def _write_tables(reference, memory, ahead, inverse, rolling, wide):
    """Writes what `window_tables` returns; memory, zeros at first, is that of `_slide` and `_inverse_norms`."""
    d, n = reference.shape
    groups, w = inverse.shape[:2]
    size = d // groups
    at_inverse = d * (4 * w + 4)
    for j in range(n):
        for axis in range(d):
            at = axis * (4 * w + 4)
            rolling[0, axis, j], rolling[1, axis, j] = _slide(reference[axis, j], j == 0, memory, at, w)
            for k in range(w):
                ahead[axis, k, j] = -memory[at + w + min(k, j)]
        for group in range(groups):
            wide[group, j] = _inverse_norms(memory, group * size, size, w, at_inverse)
            for k in range(w):
                inverse[group, k, j] = memory[at_inverse + min(k, j)]


@_inner
def _begin(memory, at, n, i):
    """Moves a drifting row (n,) back to the end of its place where it has reached the begin; returns its new begin."""
    row = memory[at : at + n + SLACK]
    if i % SLACK == 0:
        for j in range(n - 1, -1, -1):
            row[j + SLACK] = row[j]
    begin = SLACK - 1 - i % SLACK
    row[begin] = 0.0  # a new diagonal
    return at + begin


@_inner
def _grow(memory, at_rise, at, last, stop, ahead, axis):
    """A sample joins both windows of the columns before `stop`."""
    rise, ahead_q, covariance = memory[at_rise : at_rise + last + 1], ahead[axis, last], memory[at : at + stop]
    for j in range(last + 1):
        covariance[j] = _fma(rise[j], ahead_q[j], covariance[j])
    up, ahead_q, covariance = rise[last], ahead_q[last + 1 :], covariance[last + 1 :]
    for j in range(covariance.size):
        covariance[j] = _fma(up, ahead_q[j], covariance[j])


@_inner
def _roll(memory, at, w, half, both, rolling, axis):
    """A sample joins both windows of w samples, and one leaves them, in the columns from w on."""
    n = rolling.shape[2]
    covariance, half_q, both_q = memory[at + w : at + n], rolling[0, axis, w:], rolling[1, axis, w:]
    for j in range(n - w):
        covariance[j] = _fma(half, both_q[j], _fma(both, half_q[j], covariance[j]))


@_inner
def _correlate(memory, at, at_covariance, at_error, last, stop, wide, inverse_q, wide_q, group, state):
    """Adds correlations to the costs, but for those whose error may be too large; returns how many those are.

    Before `stop` windows have only grown so far, and their norms with them; later ones have rolled on.
    """
    w, n = inverse_q.shape[1:]
    inverse, q, cost = memory[at : at + w], inverse_q[group, last], state[COST : COST + n]
    covariance, error = memory[at_covariance : at_covariance + n], memory[at_error : at_error + n]
    doubtful = 0
    for j in range(last + 1):
        error[j] = _grown_error(w, inverse[j], q[j])
        sure = error[j] * inverse[j] * q[j] <= _TOLERANCE  # not where inf * 0 gives NaN
        cost[j] += covariance[j] * inverse[j] * q[j] if sure else 0.0
        doubtful += not sure
    p, q, wide_q = inverse[last], q[last + 1 :], wide_q[group, last + 1 :]
    covariance, error, cost = covariance[last + 1 :], error[last + 1 :], cost[last + 1 :]
    for j in range(stop - last - 1):
        error[j] = _grown_error(w, p, q[j])
    for j in range(cost.size):
        error[j] = _fma(wide, wide_q[j], error[j])
        sure = error[j] * p * q[j] <= _TOLERANCE
        cost[j] += covariance[j] * p * q[j] if sure else 0.0
        doubtful += not sure
    return doubtful


@_inner
def _grown_error(w, p, q):
    """Bound of the error of a covariance whose windows have only grown, and so have their norms, 1 / p and 1 / q."""
    return _ROUNDING * w / max(p * q, _SMALLEST)


@_inner
def _correlation(memory, w, k, reference, j, axis, size):
    """Correlation of the last k query samples with the k reference samples up to q_j, on `size` axes, directly."""
    # In units of the largest deviation from the window's first sample, as squares of tiny or huge ones are no numbers.
    unit_p = unit_q = 0.0
    for a in range(axis, axis + size):
        p, q = memory[a * (4 * w + 4) + w - k : a * (4 * w + 4) + w], reference[a, j + 1 - k : j + 1]
        for b in range(1, k):
            unit_p, unit_q = max(unit_p, abs(p[b] - p[0])), max(unit_q, abs(q[b] - q[0]))
    if unit_p == 0.0 or unit_q == 0.0:
        return 0.0
    pp = qq = pq = 0.0
    for a in range(axis, axis + size):
        p, q = memory[a * (4 * w + 4) + w - k : a * (4 * w + 4) + w], reference[a, j + 1 - k : j + 1]
        mean_p = mean_q = 0.0
        for b in range(1, k):
            mean_p += (p[b] - p[0]) / unit_p
            mean_q += (q[b] - q[0]) / unit_q
        mean_p /= k
        mean_q /= k
        for b in range(k):
            x, y = (p[b] - p[0]) / unit_p - mean_p, (q[b] - q[0]) / unit_q - mean_q
            pp += x * x
            qq += y * y
            pq += x * y
    return pq / (np.sqrt(pp) * np.sqrt(qq))


@_inner
def _mend(memory, at, at_covariance, at_error, last, reference, inverse_q, group, state):
    """Adds the correlations that `_correlate` left out, each computed directly from its two windows."""
    w, n = inverse_q.shape[1:]
    size = reference.shape[0] // inverse_q.shape[0]
    for j in range(n):
        p, q = memory[at + min(last, j)], inverse_q[group, last, j]
        if not memory[at_error + j] * p * q <= _TOLERANCE:
            correlation = _correlation(memory, w, min(last, j) + 1, reference, j, group * size, size)
            memory[at_covariance + j] = correlation / (p * q) if 0.0 < p * q < np.inf else 0.0
            memory[at_error + j] = _grown_error(w, p, q)
            state[COST + j] += correlation


@_inlined
def _pearson_row(sample, reference, ahead, inverse_q, rolling, wide_q, state, at_memory):
    """Windowed-Pearson distances (n,) of one more sample to all reference samples (Eq. 3).

    Differs from Eq. 3 where that is undefined: both windows are cut to the k = min(w, i + 1, j + 1) samples that
    exist (i and j from 0); fewer than 2 samples, or a flat window on either side, count as correlation 0 (distance 1).
    The tests of this file show each case. Distances are rounded to 2^-40, and to whole numbers where windows of 2
    samples correlate by +1 or -1 only: sums of distances are then exact, and rounding cannot decide between equals.

    The memory holds what `_slide` needs of each axis; then for each group inverse norms (w,) of the query's windows,
    covariances (n,) of the windows that end at this sample and at q_j, and bounds (n,) of their errors.
    """
    d, n = reference.shape
    groups, w = inverse_q.shape[:2]
    size = d // groups
    memory, cost = state[at_memory:], state[COST : COST + n]
    i = int(state[COUNT])
    last = min(i, w - 1)  # windows hold min(last, j) + 1 samples
    stop = n if i < w else w
    cost[:] = 0.0
    for group in range(groups):
        at = d * (4 * w + 4) + group * (w + 2 * (n + SLACK))
        at_covariance = _begin(memory, at + w, n, i)
        at_error = _begin(memory, at + w + n + SLACK, n, i)
        for axis in range(group * size, (group + 1) * size):
            at_axis = axis * (4 * w + 4)
            half, both = _slide(sample[axis], i == 0, memory, at_axis, w)
            _grow(memory, at_axis + 3 * w + 2, at_covariance, last, stop, ahead, axis)
            if stop < n:
                _roll(memory, at_covariance, w, half, both, rolling, axis)
        wide = _ROUNDING * _inverse_norms(memory, group * size, size, w, at)
        if i < w:
            wide = 0.0
        if _correlate(memory, at, at_covariance, at_error, last, stop, wide, inverse_q, wide_q, group, state):
            _mend(memory, at, at_covariance, at_error, last, reference, inverse_q, group, state)
    grid = 1.0 if w == 2 and size == 1 else _GRID
    for j in range(n):
        # Within the bounds, which a correlation of 1 + 1e-16 would exceed.
        cost[j] = np.rint(min(max(groups - cost[j], 0.0), 2.0 * groups) * grid) / grid


# --- the recursion ---


@_inner
def _weigh(state, n, gamma):
    """Writes exp(-cost / gamma) = weight * 2^(512 block), weight in [2^-257, 2^257], to 1 ulp of exp."""
    cost, weight, block = state[COST : COST + n], state[COST + 3 * n : COST + 4 * n], state[COST + 4 * n : COST + 5 * n]
    per_gamma = -1.0 / gamma
    for j in range(n):
        x = cost[j] * per_gamma
        whole = np.rint(x * _PER_LN2)
        r = _fma(-whole, _LN2_LOW, _fma(-whole, _LN2_HIGH, x))
        r = min(max(r, -0.35), 0.35)  # where x is so large that nothing is left of the fraction
        many = np.rint(whole / 512.0)
        # The series in an order that leaves much to do at once.
        s = r * r
        low = _fma(s, _fma(r, _C5, _C4), _fma(r, _C3, _C2))
        middle = _fma(s, _fma(r, _C9, _C8), _fma(r, _C7, _C6))
        high = _fma(s, _fma(r, _C13, _C12), _fma(r, _C11, _C10))
        exp = 1.0 + _fma(s, _fma(s * s, _fma(s * s, high, middle), low), r)
        weight[j] = _float(_bits(exp) + (_bits(_fma(many, -512.0, whole) + _TO_BITS) << _EXPONENT))
        block[j] = many


@_inner
def _write_costs(state, n, gamma, out):
    """Writes R = -gamma ln(m * 2^(512 k)); inf where nothing leads, as k is -inf there."""
    m, k = state[COST + n : COST + 2 * n], state[COST + 2 * n : COST + 3 * n]
    for j in range(n):
        bits = _bits(m[j])
        exponent = (bits - _SQRT_HALF) >> _EXPONENT
        fraction = _float(bits - (exponent << _EXPONENT))
        s = (fraction - 1.0) / (fraction + 1.0)  # |s| <= 0.1716
        z = s * s
        series = 0.0
        for power in range(21, 1, -2):
            series = z * (1.0 / power + series)
        out[j] = 0.0 - gamma * ((exponent + 512.0 * k[j]) * _LN2 + 2.0 * (s + s * series))


@_inner
def _align(m, k, to):
    """m * 2^(512 k) in units of 2^(512 to); 0 where it is beyond all digits."""
    if k == to:
        return m
    if k == to - 1.0:
        return m * _DOWN
    return 0.0


@_inner
def _cell(a_m, a_k, b_m, b_k, c_m, c_k, weight, block):
    """weight * 2^(512 block) * (a + b + c), where each is m * 2^(512 k)."""
    if a_k == b_k and a_k == c_k:
        total, unit = _fma(weight, c_m, weight * (a_m + b_m)), a_k
    else:
        unit = max(a_k, b_k, c_k)
        others = weight * (_align(a_m, a_k, unit) + _align(b_m, b_k, unit))
        total = _fma(weight, _align(c_m, c_k, unit), others)
    unit += block
    if not _LOW <= total < _HIGH:
        while total >= _HIGH:
            total, unit = total * _DOWN, unit + 1.0
        while 0.0 < total < _LOW:
            total, unit = total * _UP, unit - 1.0
    return total, unit


@_inner
def _soft_row(state, n, gamma, steps):
    """Row i of E from row i - 1, in place; returns the index of its largest value, the first of equal ones."""
    _weigh(state, n, gamma)
    m, k = state[COST + n : COST + 2 * n], state[COST + 2 * n : COST + 3 * n]
    weight, block = state[COST + 3 * n : COST + 4 * n], state[COST + 4 * n : COST + 5 * n]
    none = -np.inf
    diagonal_m, diagonal_k = m[0], k[0]
    older_m, older_k = 0.0, none
    if state[COUNT] == 0.0:
        m[0], k[0] = 1.0, 0.0  # R[0, 0]
    left_m, left_k = _cell(m[0], k[0], 0.0, none, 0.0, none, weight[0], block[0])
    m[0], k[0] = left_m, left_k
    top = left_k
    for j in range(1, n):
        above_m, above_k = m[j], k[j]
        if steps == SYMMETRIC1:
            left_m, left_k = _cell(above_m, above_k, diagonal_m, diagonal_k, left_m, left_k, weight[j], block[j])
        elif steps == SYMMETRIC2:
            left_m, left_k = _cell(
                above_m, above_k, diagonal_m * weight[j], diagonal_k + block[j], left_m, left_k, weight[j], block[j]
            )
        else:
            left_m, left_k = _cell(above_m, above_k, diagonal_m, diagonal_k, older_m, older_k, weight[j], block[j])
        older_m, older_k = diagonal_m, diagonal_k
        diagonal_m, diagonal_k = above_m, above_k
        m[j], k[j] = left_m, left_k
        if left_k > top:
            top = left_k
    peak = 0
    for j in range(n):
        peak = max(peak, _bits(m[j]) if k[j] == top else 0)
    for j in range(n):
        if k[j] == top and _bits(m[j]) == peak:
            return j
    return 0


@_inner
def _hard_row(state, n, steps):
    """Row i of R from row i - 1, in place, with the hard minimum; returns the index of its first minimum."""
    cost, row = state[COST : COST + n], state[COST + n : COST + 2 * n]
    diagonal, older = row[0], np.inf
    left = cost[0] if state[COUNT] == 0.0 else row[0] + cost[0]
    row[0] = left
    for j in range(1, n):
        above = row[j]
        skip = diagonal + cost[j] if steps == SYMMETRIC2 else diagonal
        third = older if steps == ASYMMETRIC else left
        other = skip if skip < above else above
        left = (third if third < other else other) + cost[j]
        row[j] = left
        older, diagonal = diagonal, above
    least = _bits(np.inf)
    for j in range(n):
        least = min(least, _bits(row[j]))  # costs are not negative, so that their bits are in order
    for j in range(n):
        if _bits(row[j]) == least:
            return j
    return 0


@_compiled
def write_accumulated_cost(state, n, gamma, out):
    """Writes R[i, 1..n] of a state to `out` (n,)."""
    if gamma > 0.0:
        _write_costs(state, n, gamma, out)
        return
    for j in range(n):  # a slice on the right would take numba seconds to compile
        out[j] = state[COST + n + j]


@_inner
def _first_minimum(state, n, gamma, normalization):
    """Index of the first minimum of R divided by the length of the path; costs equal but for rounding are equal."""
    costs = state[COST + n : COST + 2 * n]
    if gamma > 0.0:
        costs = state[COST + 3 * n : COST + 4 * n]
        _write_costs(state, n, gamma, costs)
    i = state[COUNT]
    lowest = np.inf
    for j in range(n):
        lowest = min(lowest, costs[j] / (max(i, j + 1.0) if normalization == MAX else i + j + 1.0))
    for j in range(n):
        cost = costs[j] / (max(i, j + 1.0) if normalization == MAX else i + j + 1.0)
        if cost <= lowest + _TIE * (abs(lowest) + gamma):
            return j
    return 0


@_inlined
def _advance(state, sample, reference, ahead, inverse, rolling, wide, distance, steps, normalization, gamma):
    n = reference.shape[1]
    at_memory = COST + (2 if gamma == 0.0 else 5) * n
    if distance == WP:
        _pearson_row(sample, reference, ahead, inverse, rolling, wide, state, at_memory)
    elif distance == DERIVATIVE:
        _late_derivative(sample, state, at_memory)
        _euclidean_row(state[at_memory : at_memory + sample.size], reference, False, state)
    else:
        _euclidean_row(sample, reference, distance == SQEUCLIDEAN, state)
    best = _hard_row(state, n, steps) if gamma == 0.0 else _soft_row(state, n, gamma, steps)
    state[COUNT] += 1.0
    if normalization == MAX or (normalization == STEPS and steps != ASYMMETRIC):  # there all lengths are i
        best = _first_minimum(state, n, gamma, normalization)
    state[PHASE] = best / (n - 1)


@_compiled
def step(state, sample, reference, ahead, inverse, rolling, wide, distance, steps, normalization, gamma):
    """Lines 4-8 of Algorithm 1 for one more query sample.

    Args:
        state: (num_states,), changed in place; at first zeros, with R infinite.
        sample: (d,) the query sample p_i.
        reference: (d, n) the reference q, one row per axis; for DERIVATIVE its derivatives.
        ahead, inverse, rolling, wide: from `window_tables(reference, w, g)`; of any length for other distances.
        distance: WP, EUCLIDEAN, SQEUCLIDEAN or DERIVATIVE.
        steps: SYMMETRIC1, SYMMETRIC2 or ASYMMETRIC.
        normalization: NONE, MAX or STEPS.
        gamma: smoothing of the minimum, >= 0.

    Returns:
        The phase; NaN where a value is not finite or above `LARGEST`: nothing has changed then.
    """
    for axis in range(sample.size):
        if not abs(sample[axis]) <= LARGEST:
            return np.nan
    _advance(state, sample, reference, ahead, inverse, rolling, wide, distance, steps, normalization, gamma)
    return state[PHASE]


@_compiled
def phases(state, query, reference, ahead, inverse, rolling, wide, distance, steps, normalization, gamma, out):
    """Algorithm 1 for a query (m, d): `out` (m,) receives the phases, Eq. 2. The rest is as in `step`."""
    for i in range(query.shape[0]):
        _advance(state, query[i], reference, ahead, inverse, rolling, wide, distance, steps, normalization, gamma)
        out[i] = state[PHASE]
