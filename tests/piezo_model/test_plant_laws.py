"""Laws that each simulated hysteresis obeys or violates, and its distance from the model class."""

import numpy as np
from driven_plants import NAMES, TS, every_plant, ramp, walk

from piezo_model import plants
from piezo_model.operators import creep, dead_zone, play
from piezo_model.signals import decaying_triangle, multi_sine

# Laws of the relay Preisach plane


def test_preisach_equals_a_plane_of_single_relays():
    plant = plants.get("relay_preisach", creep_share=0.0, lines=12)
    x = ramp(0.0, 120.0, 30.0, 100.0, 60.0, 150.0, 20.0, 90.0, per_ramp=40)
    y = plant.run(x)

    # Relay by relay, without plays: half widths r, centres s, and the density as the slope of the line's distribution.
    r = (np.arange(12)[:, None] + 0.5) / 12
    s = np.linspace(-1.0, 1.0, 8001)[None, :] * (1.0 - r)
    t = (s - (0.15 - 0.5 * r)) / (1.1 - 0.6 * r)
    density = (1.0 + t**2) ** -1.5
    density *= np.exp(-r / 0.45) / density.sum(axis=1, keepdims=True)
    density /= density.sum()
    up = np.zeros(s.shape, dtype=bool)
    v = []
    for u in x / 75.0 - 1.0:
        up = (up | (u >= s + r)) & ~(u <= s - r)
        v.append(0.73 * u + 0.27 * (density[up].sum() - density[~up].sum()))
    np.testing.assert_allclose(y, 20.0 * np.array(v), atol=20.0 * 5e-4)


# Laws of Bouc-Wen


def test_bouc_wen_solves_its_equation():
    plant = plants.get("bouc_wen", creep_share=0.0, exponent=1.0)
    u = np.linspace(-1.0, 1.0, 1001)
    h = plant.stiffness * (u - plant.run(75.0 + 75.0 * u) / 20.0)
    h0 = h[0]
    # For n = 1 each side of h = 0 is a linear equation: dh/du = A + (β − γ) |h| below and A − (β + γ) h above.
    A, beta, gamma = plant.loading_slope, plant.beta, plant.gamma
    below = (A + (beta - gamma) * -h0) * np.exp(-(beta - gamma) * (u + 1.0))
    zero = -1.0 - np.log(A / (A + (beta - gamma) * -h0)) / (beta - gamma)
    above = A * -np.expm1(-(beta + gamma) * (u - zero))
    exact = np.where(u < zero, (A - below) / (beta - gamma), above / (beta + gamma))
    np.testing.assert_allclose(h, exact, atol=1e-5)


def gap_of_one_minor_loop(plant):
    plant.run(ramp(0.0, 150.0, 60.0))
    loop = plant.run(ramp(60.0, 90.0, 60.0))
    return abs(loop[-1] - loop[0])


def test_a_minor_loop_of_bouc_wen_does_not_close_and_those_of_the_others_do():
    gaps = {name: gap_of_one_minor_loop(plants.get(name, creep_share=0.0)) for name in NAMES}
    assert gaps["bouc_wen"] > 0.2
    assert gaps["relay_preisach"] < 1e-10
    assert gaps["dense_prandtl_ishlinskii"] < 1e-10


# The plants are not in the model class


def voltage_width_of_minor_loop(name, low):
    """Largest width, V, of the loop between low and low + 30 V, measured along the voltage at constant displacement."""
    x = np.linspace(low, low + 30.0, 301)
    plant = plants.get(name, creep_share=0.0)
    plant.run(ramp(0.0, low))
    for _ in range(20):
        up, down = plant.run(x), plant.run(x[::-1])[::-1]
    levels = np.linspace(up[0], up[-1], 400)
    return float((np.interp(levels, up, x) - np.interp(levels, down, x)).max())


def test_the_width_of_a_minor_loop_changes_with_its_bias_for_preisach_as_it_cannot_for_prandtl_ishlinskii():
    # y = S[H[x]] with a memoryless S: the width along x at constant y is that of H, the same at each bias.
    biases = (0.0, 30.0, 60.0, 90.0, 120.0)
    widths = {name: [voltage_width_of_minor_loop(name, low) for low in biases] for name in NAMES}
    assert max(widths["dense_prandtl_ishlinskii"]) / min(widths["dense_prandtl_ishlinskii"]) < 1.001
    assert max(widths["relay_preisach"]) / min(widths["relay_preisach"]) > 1.5


def residual_of_the_model_class(x, y, n, m):
    """Relative RMS of the unconstrained least-squares fit of the paper's equation (5)."""
    u, v = x / 75.0 - 1.0, y / 20.0
    r = np.arange(n + 1) / (n + 1)
    H, _ = play(u, r, -(1.0 - r))
    K = np.stack([creep(u, r, np.full(n + 1, rate), TS, -(1.0 - r))[0] for rate in (100.0, 10.0, 1.0, 0.1)]).sum(axis=0)
    s = np.arange(-m, m + 1) / (m + 1) * np.abs(v).max()
    Xi = np.hstack([H[:, 1:], K, dead_zone(v, s), np.ones((u.size, 1))])
    weights, *_ = np.linalg.lstsq(Xi, -u, rcond=None)
    return float(np.sqrt(np.mean((Xi @ weights + u) ** 2)) / np.ptp(u))


@every_plant
def test_a_model_of_the_papers_size_comes_near_and_leaves_a_residual_without_any_noise(name):
    x = np.concatenate(
        [
            decaying_triangle(duration_s=8.0, sample_time=TS, low=0.0, high=150.0),
            walk(8.0),
            multi_sine(duration_s=8.0, sample_time=TS, low=0.0, high=150.0, highest_Hz=10.0),
        ]
    )
    residual = residual_of_the_model_class(x, plants.get(name, sample_time=TS).run(x), n=5, m=3)
    assert 5e-4 < residual < 5e-2


def test_the_residual_of_the_dense_plant_falls_as_the_model_grows():
    x = walk(20.0)
    y = plants.get("dense_prandtl_ishlinskii", sample_time=TS).run(x)
    small, large = (residual_of_the_model_class(x, y, n, m) for n, m in ((5, 3), (19, 9)))
    assert large < small / 3.0
