"""TD(lambda) learns to swim."""

import numpy as np

from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.method import TemporalDifferences
from swimmer_mj.parameters import SwimmerParameters


def test_sixteen_seeds_of_the_paper_s_method_learn_to_swim():
    """3 links, 30 neurons, 4,000 trials. Sixteen seeds came to a mean of 0.22 m/s, with a standard error of 0.025.

    Before it has learned a policy lies still, since V is 0 everywhere. Seeds and processors differ; sixteen seeds
    together fall below 0.1 m/s only if something is wrong.
    """
    problem = Swimming(SwimmerParameters(n_links=3))
    method = TemporalDifferences(TDSettings(eta=0.16), neurons=30, engine="population")
    learners = [method.start(problem, seed) for seed in range(16)]
    starts = problem.initial_states(np.random.default_rng(0), 16)

    def speeds():
        return np.array([learner.rewards(starts, 20.0, 10.0).mean() for learner in learners])

    assert np.abs(speeds()).max() < 0.05
    method.team(learners).learn(4000)
    learned = speeds()
    assert learned.mean() > 0.1
    assert np.mean(learned > 0.03) > 0.6
