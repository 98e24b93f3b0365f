"""Cross weights N of the cost z'Qz + 2z'Nu + u'Ru on the command line."""

import control
import numpy as np
from cli import answer, assert_refused, hfa


def test_the_command_line_gives_cross_weights(tmp_path):
    """The K of --N is that of python-control; N of another shape is refused."""
    A, B, N = [[0.0, 1.0], [2.0, -0.3]], [[0.0], [1.0]], np.array([[-0.2], [0.1]])
    np.savez(tmp_path / "plant.npz", A=A, B=B, Q=np.eye(2), R=np.eye(1))
    K = control.lqr(A, B, np.eye(2), np.eye(1), N)[0]
    words = ("solve", "--model", str(tmp_path / "plant.npz"))
    assert np.allclose(answer(*words, "--N=-.2;.1")["K"], K)
    assert_refused(hfa(*words, "--N", "1,2;3"), 2, "--N")
