"""PX4 logs, which the tests write byte by byte from the public description of the format."""

import struct
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa.main import main
from hfa_identify import read_record

pytest.importorskip("pyulog")

UAV = str(ROOT / "examples" / "uav.toml")
SERVOS = "uint64_t timestamp;float[2] control;"
RATES = "uint64_t timestamp;float[3] xyz;"
ATTITUDE = "uint64_t timestamp;float[4] q;"
TABLE = """
[columns]
pitch_rate = "vehicle_angular_velocity.xyz[1]"
pitch = "vehicle_attitude.pitch"
elevator = { field = "actuator_servos.control[1]", scale = 0.4, offset = -0.1 }
"""


def message(kind, content):
    """Return the bytes of a message of a log: size of the content, kind, and content."""
    return struct.pack("<HB", len(content), ord(kind)) + content


def log(path, topics, begin=5_000_000):
    """Write a log and return its path.

    topics: message name -> (format, rows of a time in µs followed by floats)
    begin: start of the log, µs
    """
    parts = [b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", begin)]
    parts.append(message("B", bytes(40)))
    parts += [message("F", f"{name}:{form}".encode()) for name, (form, _) in topics.items()]
    rows = []
    for number, (name, (_, samples)) in enumerate(topics.items()):
        parts.append(message("A", struct.pack("<BH", 0, number) + name.encode()))
        for stamp, *values in samples:
            packed = struct.pack(f"<HQ{len(values)}f", number, stamp, *values)
            rows.append((stamp, message("D", packed)))
    parts += [content for _, content in sorted(rows)]
    Path(path).write_bytes(b"".join(parts))
    return Path(path)


def test_the_command_reads_a_log(folder, capsys):
    """From a log with noise, `hfa identify` estimates two parameters within 10 %.

    Without the table of columns the log is refused.
    """
    model = hfa.load_model(UAV)
    point = hfa.trim(model)
    moves = [(0.5, 0.04), (1.5, -0.04), (2.2, 0.04), (2.6, -0.04), (3.0, 0.0)]
    flight = hfa.fly(model, point, {"elevator": moves}, duration=8)
    states = dict(zip(model.states, flight.states[::20].T, strict=True))
    stamps = 10_000 + np.round(1e6 * flight.time[::20]).astype(int)
    noise = np.random.default_rng(0).standard_normal((2, len(stamps)))
    rates = states["pitch_rate"] + 0.01 * noise[0]
    half = 0.5 * (states["pitch"] + 0.003 * noise[1])
    elevator = flight.inputs[::20, list(model.inputs).index("elevator")]
    rows = list(zip(stamps.tolist(), rates, np.cos(half), np.sin(half), elevator, strict=True))
    topics = {
        "vehicle_angular_velocity": (RATES, [(t, 0.0, q, 0.0) for t, q, *_ in rows]),
        "vehicle_attitude": (
            ATTITUDE,
            [(t + 2_000, c, 0.0, s, 0.0) for t, _, c, s, _ in rows[::2]],
        ),
        "actuator_servos": (SERVOS, [(t, 0.0, e) for t, *_, e in rows]),
    }
    log("flight.ulg", topics, begin=0)
    table = TABLE.replace("scale = 0.4, offset = -0.1", "scale = 1.0")
    Path("columns.toml").write_text(table)
    held = [f"{name}={point[name]!r}" for name in ("thrust", "aileron", "rudder")]
    words = ["identify", "flight.ulg", "--columns", "columns.toml", "--aircraft", UAV]
    words += ["--free", "Cm_q,Cm_elevator", "--inputs", "steps", "-o", "found.toml"]
    assert main([*words, *(word for each in held for word in ("--hold", each))]) == 0
    found = hfa.load_model("found.toml").parameters
    for name in ("Cm_q", "Cm_elevator"):
        assert found[name].start == pytest.approx(model.parameters[name].start, rel=0.1)
    capsys.readouterr()
    assert main([*words[:2], *words[4:]]) == 2
    assert "add --columns FILE.toml" in capsys.readouterr().err


def test_files_of_other_formats_are_not_logs(folder):
    """A file of another format is refused as a PX4 log."""
    table = Path("columns.toml")
    table.write_text(TABLE)
    Path("flight.ulg").write_bytes(b"time,alpha")
    with pytest.raises(hfa.BadInputError, match="is not a PX4 log"):
        read_record("flight.ulg", hfa.load_model(UAV), {}, table)
