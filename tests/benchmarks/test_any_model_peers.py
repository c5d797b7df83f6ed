"""PPO and SAC on the tasks of others, and their curves beside ours."""

import csv

import any_model_curves as drawn
import any_model_peers as peers
import numpy as np
import pytest

ZOO = pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")  # it is the Zoo's


def test_a_return_is_the_sum_of_the_environments_own_rewards():
    suite = pytest.importorskip("dm_control.suite", reason="there is no dm_control here")
    (found,) = peers.returns("dm_control/cartpole/balance", lambda seen: np.full(1, 0.1), [3])
    own = suite.load("cartpole", "balance")
    own.task._random = np.random.RandomState(3)
    step, total = own.reset(), 0.0
    while not step.last():
        step = own.step([0.1])
        total += step.reward
    assert found == pytest.approx(total, rel=1e-6)


@ZOO
def test_ppo_sees_the_observations_that_it_learned_with():
    learner = peers.Learner("ppo", "gymnasium/InvertedPendulum-v5", 0)
    learner.learn()
    assert learner.model.num_timesteps == 32
    assert learner.model.gamma == 0.999
    seen = np.array([0.3, -0.2, 0.5, 0.1])
    expected = learner.model.predict(learner.normalize.normalize_obs(seen), deterministic=True)[0]
    np.testing.assert_array_equal(learner.act(seen), expected)
    assert not np.array_equal(learner.act(seen), learner.model.predict(seen, deterministic=True)[0])


def test_sac_begins_with_what_the_zoo_says():
    learner = peers.Learner("sac", "gymnasium/Swimmer-v5", 0)
    learner.learn()
    assert learner.model.num_timesteps == peers.SAC_ACTIONS
    assert (learner.model.gamma, learner.model.learning_starts) == (0.9999, 10_000)


@ZOO
def test_what_is_there_is_not_learned_again(tmp_path):
    for _ in range(2):
        peers.main(("gymnasium/InvertedPendulum-v5",), ("ppo",), (5,), 0.05, tmp_path / "log.csv")
    with (tmp_path / "log.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["algorithm"], row["seed"]) == ("ppo", "5")
    assert float(row["return_min"]) <= float(row["return_mean"]) <= float(row["return_max"])


def test_curves_are_in_simulated_seconds(tmp_path):
    """Of ours by the learner's step, 0.02 s on this task; of the others by the environment's, 0.04 s."""
    task = "gymnasium/InvertedPendulum-v5"
    (tmp_path / "ours.csv").write_text(
        "task,seed,look,cpu_seconds,simulation_steps,return_mean\n"
        f"{task},7,of the learner,1.0,100,5.0\n{task},7,of the learner,3.0,300,9.0\n{task},7,best,3.0,300,8.0\n"
        f"{task},8,of the learner,2.0,200,1.0\n{task},8,of the learner,4.0,400,3.0\n"
    )
    (tmp_path / "peers.csv").write_text(
        f"task,algorithm,seed,cpu_seconds,actions,return_mean\n{task},sac,0,5.0,1000,2.0\n"
    )
    found = drawn.curves(tmp_path / "ours.csv", tmp_path / "peers.csv")[task]
    np.testing.assert_allclose(found["ours"][0].simulation, [2.0, 6.0])
    np.testing.assert_allclose(found["sac"][0].simulation, [40.0])
    at, mean = drawn.mean_curve(found["ours"], "time")
    assert (at[0], at[-1]) == pytest.approx((2.0, 3.0))
    np.testing.assert_allclose(mean, ((5 + 2 * (at - 1)) + (1 + (at - 2))) / 2)
    drawn.main(tmp_path / "ours.csv", tmp_path / "peers.csv", tmp_path)
    assert (tmp_path / "any-model-time.png").stat().st_size > 10_000
    assert (tmp_path / "any-model-simulation.png").stat().st_size > 10_000
