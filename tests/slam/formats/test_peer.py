import numpy as np
import pytest

from slam.formats import FormatError, peer

GOOD = "# GMapping\n1.0 0.5 -2 3.0 0\n\n0.9 1e1 0 7.0 1\n"


def test_poses_in_the_order_of_the_log_with_yaw_wrapped(tmp_path):
    path = tmp_path / "peer.txt"
    path.write_text(GOOD)
    np.testing.assert_allclose(peer.read(path, 2), [[0.5, -2, 3.0], [10, 0, 7.0 - 2 * np.pi]])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 2 3\n", ":1: pose of 3 values, expected at least 4: stamp x y theta"),
        ("1 2 3 4\n1 2 nan 4\n", ":2: pose: value 3 is 'nan'"),
        ("1 2 3 4\n", "1 poses, expected one for each of 2 scans"),
        ("# nothing\n", "no poses, expected lines of stamp x y theta"),
    ],
)
def test_bad_files_are_told_in_one_line(text, told, tmp_path):
    path = tmp_path / "peer.txt"
    path.write_text(text)
    with pytest.raises(FormatError) as error:
        peer.read(path, 2)
    assert told in str(error.value)
    assert "\n" not in str(error.value)
