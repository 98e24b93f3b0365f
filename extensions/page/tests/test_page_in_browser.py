"""The page of `hfa report` in a browser: slider, numbers, widths and file names."""

import json
from pathlib import Path

import pytest
from chromium import browser, set_page_width
from cli import hfa
from project import ROOT

from hfa.main import DONE

#: A file name that would run as a script if it were not escaped.
NAME = "<script>document.title=1<img src=x onerror=document.title=2>.toml"
AT = "12.5"

#: Script that returns the cells of the rows of shown tables whose first heading is the argument.
_ROWS = """return [...document.querySelectorAll('article section.point:not([hidden]) table')]
    .filter((table) => table.querySelector('th')?.textContent === arguments[0])
    .flatMap((table) => [...table.querySelectorAll('tbody tr')])
    .map((row) => [...row.children].map((cell) => cell.textContent))"""
#: Script that returns the path of the first line of the drawn aircraft.
_DRAWN = (
    "return document.querySelector('#plot-trim-1 .scatterlayer path.js-line').getAttribute('d')"
)
#: Script that returns the texts in the drawing of the aircraft.
_TEXTS = (
    "return [...document.querySelectorAll('#plot-trim-1 .textpoint text')].map((text) =>"
    " text.textContent)"
)


def settles(driver, condition):
    """Wait at most 10 s until a JavaScript expression is true.

    Drawings follow a new width with a delay.
    """
    from selenium.webdriver.support.wait import WebDriverWait

    return bool(
        WebDriverWait(driver, 10.0, 0.05).until(
            lambda _: driver.execute_script(f"return {condition}")
        )
    )


def chosen(driver):
    """Return the value that the slider shows."""
    return driver.execute_script("return document.querySelector('article .slider output').value")


def move_to(driver, angle):
    """Move the slider of the page to an angle in deg."""
    driver.execute_script(
        """const slider = document.getElementById('slider-dihedral');
        slider.value = [...document.querySelectorAll('article section.point')]
          .findIndex((section) => section.dataset.value === arguments[0]);
        slider.dispatchEvent(new Event('input'))""",
        f"{angle} deg",
    )


@pytest.mark.slow
def test_the_page_shows_numbers_in_a_browser(folder, subtests):
    """In a browser, the page of `hfa report` on the paper's aircraft, with dihedral angles 12 to 15
    deg, shows the numbers of `hfa linearize` and `hfa trim` at the angle of its slider, fits windows
    of 400 to 1600 px, escapes the name of a file, and loads nothing.

    The properties are subtests of one page, because to make it takes many seconds.
    """
    Path(NAME).write_bytes((ROOT / "hfa_model" / "parameters.toml").read_bytes())
    with browser() as driver:
        line = "report -o page.html --dihedral 15 --sweep 12:15:0.5 --parameters"
        assert hfa(*line.split(), NAME).code == DONE
        driver.get((folder / "page.html").as_uri())
        assert settles(driver, "document.body.classList.contains('scripted')")
        with subtests.test("names are escaped and nothing is loaded from elsewhere"):
            assert driver.title == "Highly flexible aircraft: linear models"
            assert NAME in driver.find_element("tag name", "main").get_attribute("textContent")
            assert (
                driver.execute_script("return performance.getEntriesByType('resource').length") == 0
            )
            move_to(driver, "15")
        with subtests.test("the keyboard moves the slider, which shows the sections of an angle"):
            assert chosen(driver) == "15 deg"
            driver.find_element("id", "slider-dihedral").send_keys("\ue012")  # arrow left
            assert chosen(driver) == "14.5 deg"
            shown = driver.execute_script(
                "return document.querySelectorAll('article section.point:not([hidden])').length"
            )
            assert shown == 3
        with subtests.test("matrices, modes, trim and drawing are those of the chosen angle"):
            before = driver.execute_script(_DRAWN)
            move_to(driver, AT)
            assert chosen(driver) == f"{AT} deg"
            compare_with_the_command(driver)
            assert driver.execute_script(_DRAWN) != before
        with subtests.test("no table and no drawing is wider than the window"):
            for width in (1600, 400):
                set_page_width(driver, width)
                assert settles(driver, f"document.documentElement.scrollWidth <= {width}"), width
        with subtests.test("the browser logs no error"):
            assert driver.get_log("browser") == []


def compare_with_the_command(driver):
    """Assert that the page shows the results of `hfa linearize` and `hfa trim` at `AT`: matrices,
    damping, throttle, loads and hinge moment, up to half a unit of the last shown digit.
    """
    words = ("--dihedral", AT, "--parameters", NAME, "--json")
    model, trim = (json.loads(hfa(name, *words).out) for name in ("linearize", "trim"))
    for letter in ("A", "B"):
        shown = [[float(cell) for cell in row[1:]] for row in driver.execute_script(_ROWS, letter)]
        assert shown == [
            [pytest.approx(value, abs=5.001e-5) for value in row] for row in model[letter]
        ]
    shown = driver.execute_script(_ROWS, "mode")
    modes = shown[: len(model["modes"])]  # then the table of their periods
    assert [row[0] for row in modes] == [mode["name"] for mode in model["modes"]]
    assert [float(row[2]) for row in modes] == [
        pytest.approx(mode["damping"], abs=5.001e-5) for mode in model["modes"]
    ]
    trimmed = {row[0]: row[1] for row in driver.execute_script(_ROWS, "trim")}
    assert float(trimmed["throttle"]) == pytest.approx(
        trim["operating_point"]["inputs"]["throttle"], rel=5.001e-6
    )
    loads = trim["sheet"]
    texts = driver.execute_script(_TEXTS)
    for name in ("lift outer", "lift center"):
        assert f"{loads[name]['value']:.1f} lbf" in texts
    assert f"{loads['hinge moment']['value']:.1f}ft lbf" in texts  # the text has two lines
