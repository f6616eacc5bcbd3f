"""The two INS models, against answers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sim.dead_reckoning import InertialConfig, ShockConfig, attitude, ins_poses, shocks

QUIET = InertialConfig(yaw_noise=0.0, position_noise=0.0)
CONSISTENT = InertialConfig(model="consistent", yaw_noise=0.0, position_noise=0.0)
CORNER = np.array([[0, 0, 0], [1, 0, 0], [1, 0, np.pi / 2], [1, 1, np.pi / 2]], dtype=float)
TIME = np.arange(4.0)


def reckoned(truth, config, jumps=None, seed=0):
    jumps = np.zeros(len(truth)) if jumps is None else jumps
    return ins_poses(truth, np.arange(float(len(truth))), jumps, config, np.random.default_rng(seed))


@pytest.mark.parametrize("config", [QUIET, CONSISTENT])
def test_without_noise_it_is_the_truth(config):
    np.testing.assert_allclose(reckoned(CORNER, config), CORNER, atol=1e-12)


def test_usarsim_position_ignores_the_yaw_error():
    jumps = np.array([0.0, 0.3, 0.0, 0.0])
    ins = reckoned(CORNER, QUIET, jumps)
    np.testing.assert_allclose(ins[:, :2], CORNER[:, :2])
    np.testing.assert_allclose(ins[:, 2] - CORNER[:, 2], [0.0, 0.3, 0.3, 0.3])


def test_consistent_position_follows_the_yaw_error():
    """A jump of 0.2 during the first metre (0.1 on average over it), and 0.2 during the last."""
    ins = reckoned(CORNER, CONSISTENT, np.array([0.0, 0.2, 0.0, 0.0]))
    corner = np.array([np.cos(0.1), np.sin(0.1)])
    np.testing.assert_allclose(ins[1, :2], corner)
    np.testing.assert_allclose(ins[3, :2], corner + np.array([-np.sin(0.2), np.cos(0.2)]))


def test_yaw_drifts_with_turning_and_not_at_rest():
    """Noise on 100 turns of 0.05 rad: error deviation 0.2 * 0.05 * √100 = 0.1 rad."""
    config = InertialConfig(yaw_noise=0.2, position_noise=0.0)
    turning = np.column_stack([np.zeros((101, 2)), 0.05 * np.arange(101)])
    errors = [reckoned(turning, config, seed=k)[-1, 2] - 5.0 for k in range(400)]
    assert np.std(errors) == pytest.approx(0.1, rel=0.1)
    straight = np.column_stack([np.arange(101.0), np.zeros((101, 2))])
    np.testing.assert_allclose(reckoned(straight, config)[:, 2], 0.0)


def test_position_wanders_with_distance():
    """Noise 0.1 of steps of 0.5 m: after 100 steps 0.1 * 0.5 * √100 = 0.5 m a side."""
    config = InertialConfig(yaw_noise=0.0, position_noise=0.1)
    straight = np.column_stack([0.5 * np.arange(101.0), np.zeros((101, 2))])
    errors = [reckoned(straight, config, seed=k)[-1, 1] for k in range(400)]
    assert np.std(errors) == pytest.approx(0.5, rel=0.1)


def test_precision_draws_one_drift_for_the_run():
    """Uniform of width 1/P² on yaw: the same share of every turn, and at most half the width."""
    config = InertialConfig(yaw_noise=0.0, position_noise=0.0, precision=5.0)
    turning = np.column_stack([np.zeros((11, 2)), 0.1 * np.arange(11)])
    drifts = []
    for seed in range(50):
        error = reckoned(turning, config, seed=seed)[:, 2] - turning[:, 2]
        np.testing.assert_allclose(np.diff(error), error[1], atol=1e-12)
        drifts.append(error[-1])
    assert 0.3 * 0.02 < np.max(np.abs(drifts)) <= 0.5 / 25.0


def test_gyro_bias_drifts_at_rest():
    config = InertialConfig(yaw_noise=0.0, position_noise=0.0, bias_walk=0.01)
    still = np.zeros((50, 3))
    ins = reckoned(still, config)
    assert np.ptp(ins[:, 2]) > 0.01
    assert np.all(ins[:, :2] == 0.0)


def test_the_bias_walks():
    """Variance σ² t after a time t; the yaw error is its integral, whose variance is σ² t³ / 3."""
    config = InertialConfig(yaw_noise=0.0, position_noise=0.0, bias_walk=0.01)
    yaw = np.array([reckoned(np.zeros((201, 3)), config, seed=k)[:, 2] for k in range(800)])
    bias = np.diff(yaw, axis=1)  # readings are 1 s apart
    for t in (50, 100, 200):
        assert bias[:, t - 1].var() == pytest.approx(1e-4 * t, rel=0.15)
        assert yaw[:, t].var() == pytest.approx(1e-4 * t**3 / 3.0, rel=0.2)


def test_unknown_models_and_precisions_are_refused():
    with pytest.raises(ValueError, match="INS model"):
        InertialConfig(model="perfect")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="INS precision"):
        InertialConfig(precision=0.0)


def test_shocks_come_from_hard_blows_and_are_rare():
    time = 0.1 * np.arange(100)
    impulse = np.zeros(100)
    impulse[[10, 12, 70, 80]] = 20.0, 20.0, 11.0, 5.0  # the second comes too soon, the last is soft
    config = ShockConfig(impulse=10.0, rest=5.0)
    jumps = shocks(time, impulse, config, np.random.default_rng(0))
    np.testing.assert_array_equal(np.flatnonzero(jumps.any(axis=1)), [10, 70])
    many = np.array([shocks(time, impulse, config, np.random.default_rng(k))[10] for k in range(200)])
    assert np.all(np.abs(many) >= 0.8 * config.jump)
    assert np.all(np.abs(many) <= 1.2 * config.jump)
    assert np.abs(many.mean(axis=0)).max() < 0.2 * config.jump  # either way


def test_attitude_is_noisy_truth_and_keeps_a_jump_in_roll():
    tilt = np.full((4000, 2), 0.1)
    jumps = np.zeros(4000)
    jumps[2000] = 0.2
    reported = attitude(tilt, jumps, InertialConfig(attitude_noise=0.01), np.random.default_rng(0))
    assert reported[:2000, 0].mean() == pytest.approx(0.1, abs=1e-3)
    assert reported[2000:, 0].mean() == pytest.approx(0.3, abs=1e-3)
    assert reported[:, 1].mean() == pytest.approx(0.1, abs=1e-3)
    assert reported[:, 1].std() == pytest.approx(0.01, rel=0.05)
    assert np.all(tilt == 0.1)
