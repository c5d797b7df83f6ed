"""The swimmer as an environment: dm_control tasks, Gymnasium environments, vectors of them."""
