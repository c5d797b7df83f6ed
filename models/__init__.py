"""MJCF: the template of a swimmer, and the paper's swimmers of 3, 4 and 5 links, which open in any MuJoCo viewer."""
