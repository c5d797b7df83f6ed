"""The comparison learns what it says, once."""

import csv

import pytest
import swimmer_coordinates as compared


@pytest.mark.parametrize(("name", "links"), [("joints, held", "5"), ("joints, held, 6 links", "6")])
def test_what_is_there_is_not_learned_again(tmp_path, name, links):
    out = tmp_path / "looks.csv"
    for _ in range(2):
        compared.main((name,), seeds=(1,), seconds=0.2, out=out)
    with out.open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["name"], row["seed"], row["links"]) == (name, "1", links)
    assert all(-1 < float(row[speed]) < 4 for speed in ("speed", "steady_speed"))
