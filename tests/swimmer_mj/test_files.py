import os
import stat

import pytest

from swimmer_mj.cli import main
from swimmer_mj.files import replacing


def test_a_file_takes_the_place_of_another_when_it_is_whole(tmp_path):
    path = tmp_path / "new" / "file.txt"
    for text in ("one", "two"):
        with replacing(path) as partial:
            assert partial.suffix == ".txt"
            partial.write_text(text)
            assert not path.exists() or path.read_text() == "one"
        assert path.read_text() == text
    assert [*path.parent.iterdir()] == [path]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no such pipes here")
def test_what_is_no_file_is_not_replaced(tmp_path, capsys):
    """Root could: of /dev/null nothing would be left."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for arguments in (["page", "swim3-paper", "--out"], ["validate", "--html"]):
        assert main([*arguments, str(pipe)]) == 2
        assert f"must be a file in an existing directory, got {pipe}" in capsys.readouterr().err
    for path in (pipe, tmp_path):
        message = f"{path} is there and is no regular file; choose another name"
        with pytest.raises(FileExistsError, match=message), replacing(path) as partial:
            partial.touch()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert [*tmp_path.iterdir()] == [pipe]
