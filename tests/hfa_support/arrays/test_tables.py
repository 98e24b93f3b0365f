"""Tables with named columns: layouts of files and frames, units, decimals, and refusals."""

from pathlib import Path

import numpy as np
import pytest

from hfa_support.arrays.columns import matched
from hfa_support.arrays.tables import read_source
from hfa_support.errors import BadInputError

pytestmark = pytest.mark.usefixtures("folder")
KNOWN = {"time": "s", "speed": "m/s", "alpha": "rad"}


def read(source):
    """Return name -> numbers of a table whose columns are all known."""
    columns = matched(read_source(source).columns, KNOWN)
    assert {*columns} <= {*KNOWN}
    return {name: column.numbers(KNOWN[name]) for name, column in columns.items()}


def written(text, encoding="utf-8"):
    """Write a text to a file, and return its name."""
    Path("table.csv").write_bytes(text.encode(encoding))
    return "table.csv"


#: Texts of the same table: times 0 and 0.5 s, speeds 35.5 and 36 m/s.
SAME = {
    "commas": "time,speed\n0,35.5\n0.5,36\n",
    "semicolons": "Time (ms);speed [km/h]\n0;127,8\n500;129,6\n",
    "capitals": "TIME [MS],Speed [KM/H]\n0,127.8\n500,129.6\n",
    "tabs": "t\tspeed\n0\t35,5\n0,5\t36\n",
    "quoted decimals": 'time,speed\n0,"35,5"\n"0,5",36\n',
    "comments": "# by hand\n\ntime,speed\n0,35.5\n# later\n0.5,36\n",
    "index of pandas": ",time,speed\n0,0,35.5\n1,0.5,36\n",
    "provenance": 'time,speed,about\n0,35.5,"{""schema"": 1}"\n0.5,36,\n',
    "blank column": "time,speed,\n0,35.5,\n0.5,36,\n",
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("layout", SAME)
def test_layouts_of_one_table_are_read_alike(layout, encoding):
    """Separators, decimal commas, units in both brackets and encodings do not change the numbers."""
    found = read(written(SAME[layout], encoding))
    np.testing.assert_allclose(found["time"], [0.0, 0.5])
    np.testing.assert_allclose(found["speed"], [35.5, 36.0])


def test_frames_and_arrays_are_read_alike():
    """Mappings, .npz files, frames of pandas, polars and xarray have the columns of a text."""
    columns = {"time [s]": [0.0, 0.5], "speed [m/s]": [35.5, 36.0]}
    np.savez("table.npz", **columns)
    sources = [columns, "table.npz"]
    for library, frame in (("pandas", "DataFrame"), ("polars", "DataFrame")):
        sources.append(getattr(pytest.importorskip(library), frame)(columns))
    sources.append(sources[2].set_index("time [s]"))
    for source in sources:
        assert {name: each.tolist() for name, each in read(source).items()} == {
            "time": [0.0, 0.5],
            "speed": [35.5, 36.0],
        }


#: Suffix -> library that writes it, and how.
WRITERS = {
    ".parquet": ("pyarrow", lambda frame, file: frame.to_parquet(file)),
    ".feather": ("pyarrow", lambda frame, file: frame.to_feather(file)),
    ".xlsx": ("openpyxl", lambda frame, file: frame.to_excel(file, index=False)),
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_file_of_a_library_equals_the_text(suffix):
    """.parquet, .feather and .xlsx have the columns, units and empty cells of the text."""
    frame = pytest.importorskip("pandas").DataFrame(
        {"Time (ms)": [0, 500, 1000], "speed [km/h]": [127.8, np.nan, 129.6]}
    )
    library, write = WRITERS[suffix]
    pytest.importorskip(library)
    frame.to_csv("table.csv", index=False)
    write(frame, f"table{suffix}")
    of_text, of_library = read("table.csv"), read(f"table{suffix}")
    for name in ("time", "speed"):
        np.testing.assert_allclose(of_library[name], of_text[name], rtol=1e-14)


def test_commas_between_thousands():
    """Between commas, "1,250" is 1250, as spreadsheets write it; between tabs it could be 1.25."""
    assert read(written('time,speed\n0,"1,250"\n'))["speed"] == [1250.0]


def test_degrees_of_windows_and_empty_cells():
    """A file in Windows' encoding has its degree sign; an empty cell is nan."""
    found = read(written("time;alpha [°]\n0;180\n0,5;\n", "cp1252"))
    np.testing.assert_allclose(found["alpha"], [np.pi, np.nan])


#: Text -> words of its refusal.
REFUSED = {
    "": "is empty",
    "time,speed\n0\n": "row 2 has 1 cells, but row 1 has 2",
    "time,speed\n0,1,2\n": "row 2 has 3 cells, but row 1 has 2",
    "time,\n0,1\n": "row 1 has a column without a name",
    "time,Time\n0,1\n": "row 1 has time twice",
    "time_ms,speed\n0,1\n": "unknown column 'time_ms'; write \"time [ms]\"",
    "time,speed [kg]\n0,1\n": "row 1: speed is in kg; give it in m/s",
    "time,speed\n0,x\n": "row 2: speed is 'x'; give a number",
    "time\tspeed\n0\t1,250\n": "1,250, whose comma may separate thousands",
    "time;speed\n0;1,5\n1;2.5\n": "decimal commas and points",
    "time,alpha\n0,1\n": "row 1: alpha has no unit; write alpha [deg] or alpha [rad]",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_faulty_table_is_refused_with_its_row(text):
    """A faulty table is refused with the row and the column."""
    with pytest.raises(BadInputError) as refused:
        read(written(text))
    assert REFUSED[text] in str(refused.value)
