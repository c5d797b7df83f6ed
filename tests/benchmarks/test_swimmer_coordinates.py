"""The comparison learns what it says, once."""

import csv

import swimmer_coordinates as compared


def test_what_is_there_is_not_learned_again(tmp_path):
    out = tmp_path / "looks.csv"
    for _ in range(2):
        compared.main(("joints, held",), seeds=(1,), seconds=0.2, out=out)
    with out.open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["name"], row["seed"], row["links"]) == ("joints, held", "1", "5")
    assert all(-1 < float(row[speed]) < 4 for speed in ("speed", "steady_speed"))
