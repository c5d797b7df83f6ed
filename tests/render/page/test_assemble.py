import dataclasses
import json
from pathlib import Path

import pytest

from swimmer_mj.cli import main
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.pretrained import pretrained_swimmers
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.render.page import assemble
from swimmer_mj.render.page.policies import describe


def test_a_bundle_is_one_module():
    modules = {
        "a.js": "export const one = 1;\nexport async function two() {}\nconst hidden = 3;\n",
        "b.js": 'import { one, two } from "./a.js";\n\nexport class Three {}\n',
    }
    text = assemble.bundle(modules)
    assert text.count("import") == text.count("export") == 0
    assert text.index("const one") < text.index("async function two") < text.index("class Three")


@pytest.mark.parametrize(
    ("modules", "complaint"),
    [
        ({"b.js": 'import { one } from "./a.js";\n'}, "b.js imports one from a.js"),
        (
            {"a.js": "const one = 1;\n", "b.js": 'import { one } from "./a.js";\n'},
            "b.js imports one from a.js",
        ),
        ({"a.js": "export default 1;\n"}, "only named imports and exports"),
        ({"a.js": 'import * as b from "./b.js";\n'}, "only named imports and exports"),
    ],
)
def test_what_cannot_be_bundled_is_refused(modules, complaint):
    with pytest.raises(ValueError, match=complaint):
        assemble.bundle(modules)


def described(problem, name="own"):
    return describe(GreedyPolicy(problem, Cascade(problem.n_inputs, 8)), name, "label", 1.0, None)


def test_a_policy_of_ones_own_is_on_the_page():
    one = described(Swimming())
    html = assemble.page([one])
    assert json.dumps(one["network"]["weights"]) in html
    with pytest.raises(ValueError, match="names that differ"):
        assemble.page([one, one])
    with pytest.raises(ValueError, match="there is no policy 'other' on the page; there are own"):
        assemble.page([one], "other")


def test_text_of_a_policy_cannot_end_the_script():
    name = "</script><!--"
    html = assemble.page([described(Swimming(), name)])
    assert html.count("</script>") == 4
    assert "<!--" not in html.split('id="content">')[1]
    content = json.loads(html.split('id="content">')[1].split("</script>")[0])
    assert content["chosen"] == content["policies"][0]["name"] == name


def test_what_the_page_cannot_play_is_refused_in_one_line():
    angles = dataclasses.replace(Swimming(), encoding="angle")
    with pytest.raises(
        ValueError, match="own: the page knows networks that hear cosines and sines of angles"
    ):
        described(angles)

    class Mine(Swimming):
        pass

    with pytest.raises(ValueError, match="own learned 'swim5'; the page shows swimmers only"):
        described(Mine())


def test_a_page_that_would_be_too_large_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(assemble, "MAX_BYTES", 1000)
    with pytest.raises(ValueError, match="1,000 are allowed"):
        assemble.write_page(tmp_path / "page.html", [described(Swimming())])
    assert list(tmp_path.iterdir()) == []


RUNS = Path(__file__).parents[2] / "learning" / "runs" / "version-0.1"
PENDULUM, SWIMMER = RUNS / "td", RUNS / "value-gradient"


def test_the_command(tmp_path, capsys):
    out = tmp_path / "swim.html"
    assert main(["page", str(SWIMMER), "--out", str(tmp_path)]) == 2
    assert "--out must be a file in an existing directory" in capsys.readouterr().err
    assert main(["page", str(SWIMMER), "--out", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["bytes"] == out.stat().st_size < assemble.MAX_BYTES
    assert report["policies"] == [str(SWIMMER), *pretrained_swimmers()]
    assert f'"chosen": {json.dumps(str(SWIMMER))}' in out.read_text()


def test_the_command_refuses_what_is_no_swimmer(tmp_path, capsys):
    assert main(["page", str(PENDULUM), "--out", str(tmp_path / "swim.html")]) == 2
    complaint = capsys.readouterr().err
    assert complaint.endswith("learned 'pendulum'; the page shows swimmers only\n")
    assert complaint.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
