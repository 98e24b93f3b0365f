"""The page of `hfa report` in a browser: slider, numbers, widths, printing and file names."""

import base64
import json
import re
from pathlib import Path

import pytest
from chromium import browser, set_page_width
from cli import hfa
from project import ROOT

from hfa.main import DONE

#: A file name that would run as a script if it were not escaped.
NAME = "<script>document.title=1<img src=x onerror=document.title=2>.toml"
AT = "12.5"

#: All buttons of a plot: none of them, as one that Plotly has by default, sends the plot to a
#: server.
BUTTONS = [
    "Zoom in",
    "Zoom out",
    "Autoscale",
    "Reset axes",
    "Zoom",
    "Pan",
    "Download plot as a PNG",
]

#: Script that returns the cells of the rows of shown tables whose first heading is the argument.
_ROWS = """return [...document.querySelectorAll('article section.point:not([hidden]) table')]
    .filter((table) => table.querySelector('th')?.textContent === arguments[0])
    .flatMap((table) => [...table.querySelectorAll('tbody tr')])
    .map((row) => [...row.children].map((cell) => cell.textContent))"""
#: Script that returns the path of the first line of the drawn aircraft.
_DRAWN = (
    "return document.querySelector('#plot-trim-1 .scatterlayer path.js-line').getAttribute('d')"
)
#: Script that returns the largest vertical distance, px, between the mark of a plot and the place
#: of its value on the axis, which the labels of the axis give.
_OFF_AXIS = """return Math.max(...[...document.querySelectorAll('article .plot')].map((box) => {
    const middle = (drawn) => {
      const { top, bottom } = drawn.getBoundingClientRect();
      return (top + bottom) / 2;
    };
    const ticks = [...box.querySelectorAll('.ytick text')];
    const first = ticks[0], last = ticks[ticks.length - 1];
    const value = (tick) => Number(tick.textContent.replace('\u2212', '-'));
    const slope = (middle(last) - middle(first)) / (value(last) - value(first));
    const marks = [...box.querySelectorAll('.scatterlayer .trace')]
      .filter((trace) => trace.__data__[0].trace.marker?.symbol !== 'arrow')
      .flatMap((trace) => [...trace.querySelectorAll('.points path')]);
    return Math.max(...marks.map((mark) =>
      Math.abs(middle(mark) - middle(first) - slope * (mark.__data__.y - value(first)))));
  }))"""
#: Script that returns the right edge of the verdicts, px, 1e9 if they must be scrolled to be seen.
_VERDICTS_RIGHT = """const table = document.querySelector('.verdicts table');
    const right = table.getBoundingClientRect().right;
    return right > table.parentElement.getBoundingClientRect().right + 1 ? 1e9 : right"""
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
    of 400 to 1920 px and paper, escapes the name of a file, and loads nothing.

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
            buttons = driver.find_elements("css selector", "#plot-trim-1 .modebar-btn")
            assert [button.get_attribute("data-title") for button in buttons] == BUTTONS
        with subtests.test(
            "when the page is loaded, marks of plots are at their values and verdicts are visible"
        ):
            for width in (1920, 1400, 1000, 400):
                set_page_width(driver, width)
                driver.refresh()
                assert settles(driver, "document.body.classList.contains('scripted')")
                assert driver.execute_script(_OFF_AXIS) <= 2.0, width
                right = driver.execute_script(_VERDICTS_RIGHT)
                assert right <= driver.execute_script("return window.innerWidth"), width
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
        with subtests.test(
            "the page is 8 windows high at most, and a link of the contents unfolds its section"
        ):
            set_page_width(driver, 1400)
            assert driver.execute_script("return document.documentElement.scrollHeight") <= 8 * 900
            links = driver.find_elements("css selector", "article nav a")
            assert len(links) >= 5
            links[0].click()
            assert settles(driver, "document.querySelector('article > details').open")
            gone = "document.querySelector('.slider').getBoundingClientRect().bottom <= 2"
            assert settles(driver, gone), "the slider stays within its section"
            driver.execute_script(
                "document.querySelectorAll('details').forEach((part) => { part.open = true; })"
            )
        with subtests.test("no table and no drawing is wider than the window"):
            for width in (1600, 400):
                set_page_width(driver, width)
                assert settles(driver, f"document.documentElement.scrollWidth <= {width}"), width
        with subtests.test("prints to A4"):
            set_page_width(driver, 688, medium="print")  # paper width of 182 mm between the margins
            wide = "return [...document.querySelectorAll('table')].filter((t) => t.offsetParent)"
            assert (
                max(driver.execute_script(f"{wide}.map((t) => t.getBoundingClientRect().right)"))
                <= 689
            )
            pdf = driver.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"]
            assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(pdf))) > 4
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
