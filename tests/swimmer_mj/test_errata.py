"""Each slip of the paper's appendix is shown by a snippet in docs/errata.md; here they run and are held to it."""

import re
from pathlib import Path

import numpy as np
import pytest

ERRATA = Path(__file__).parents[2] / "docs" / "errata.md"


@pytest.fixture(scope="module")
def results():
    """The variables that each snippet leaves behind."""
    namespaces = []
    for snippet in re.findall(r"```python\n(.*?)```", ERRATA.read_text(encoding="utf-8"), re.DOTALL):
        namespace = {}
        exec(snippet, namespace)
        namespaces.append(namespace)
    return namespaces


def test_inertia_of_a_rod_goes_with_the_square_of_its_length(results):
    rod = results[0]
    assert rod["corrected"] == pytest.approx(rod["by_pieces"], rel=1e-8)
    assert rod["in_the_code"] == pytest.approx(rod["by_pieces"], rel=1e-8)
    assert rod["as_printed"] == pytest.approx(rod["l"] * rod["by_pieces"], rel=1e-8)


def test_force_balance_is_the_second_of_the_two_lines(results):
    forces = results[1]
    np.testing.assert_allclose(forces["used"], forces["by_mujoco"], rtol=1e-5)
    np.testing.assert_allclose(forces["ma"].sum(axis=0), 0, atol=1e-3)
    assert np.linalg.norm(forces["printed"][1] - forces["by_mujoco"][1]) > 1
