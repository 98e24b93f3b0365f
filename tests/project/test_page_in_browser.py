"""The page of `hfa report` in a real browser: the slider, the numbers, widths, colors, printing, names of files."""

from __future__ import annotations

import base64
import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from browser import browser, screenshot, seen_at, settles
from cli import hfa
from project import ROOT

from hfa_cli.main import DONE

#: A name that would be a program if it were not escaped, in HTML and in the data of a script.
NAME = "<script>document.title=1<img src=x onerror=document.title=2>.toml"
AT = "12.5"

#: None that sends the plot to somebody.
BUTTONS = ["Zoom in", "Zoom out", "Autoscale", "Reset axes", "Zoom", "Pan", "Download plot as a PNG"]

_LEGEND_ABOVE = """[...document.querySelectorAll('.plot')].every((plot) =>
    plot.querySelector('.legend').getBoundingClientRect().bottom
      <= plot.querySelector('.gridlayer').getBoundingClientRect().top)"""
_ROWS = """return [...document.querySelectorAll('section.point:not([hidden]) table')]
    .filter((table) => table.querySelector('th').textContent === arguments[0])
    .flatMap((table) => [...table.querySelectorAll('tbody tr')])
    .map((row) => [...row.children].map((cell) => cell.textContent))"""
_CONTRAST = """const parts = (color) => color.match(/[0-9.]+/g).slice(0, 3).map((part) => part / 255)
    .map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
  const light = (color) => parts(color).reduce((sum, part, i) => sum + [0.2126, 0.7152, 0.0722][i] * part, 0);
  const style = getComputedStyle(document.documentElement), text = document.querySelector('.plot text');
  const back = light(style.backgroundColor);
  return [style.color, getComputedStyle(text).fill].map(light)
    .map((front) => (Math.max(front, back) + 0.05) / (Math.min(front, back) + 0.05))"""
_DRAWN = "return document.querySelector('#plot-trim-1 .scatterlayer path.js-line').getAttribute('d')"
_TEXTS = "return [...document.querySelectorAll('#plot-trim-1 .textpoint text')].map((text) => text.textContent)"


def chosen(driver: Any) -> str:
    return driver.execute_script("return document.getElementById('angle').value")


def move_to(driver: Any, angle: str) -> None:
    """Move the slider to an angle as a pointer does."""
    driver.execute_script(
        """const slider = document.getElementById('dihedral');
        slider.value = [...document.querySelectorAll('section.point')]
          .findIndex((section) => section.dataset.angle === arguments[0]);
        slider.dispatchEvent(new Event('input'))""",
        f"{angle} deg",
    )


@pytest.mark.slow
def test_the_page_in_a_browser(tmp_path: Path, subtests: pytest.Subtests, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path(NAME).write_bytes((ROOT / "hfa_model" / "parameters.toml").read_bytes())
    with browser() as driver:
        assert (
            hfa("report", "-o", "page.html", "--parameters", NAME, "--dihedral", "15", "--sweep", "12:15:0.5").code
            == DONE
        )
        driver.get((tmp_path / "page.html").as_uri())
        assert settles(driver, "document.body.classList.contains('scripted')")
        with subtests.test("names are escaped and nothing is loaded from elsewhere"):
            assert driver.title == "Highly flexible aircraft: linear models"
            assert NAME in driver.find_element("tag name", "main").get_attribute("textContent")
            assert driver.execute_script("return performance.getEntriesByType('resource').length") == 0
            buttons = driver.find_elements("css selector", "#plot-trim-1 .modebar-btn")
            assert [each.get_attribute("data-title") for each in buttons] == BUTTONS
        with subtests.test("the keyboard moves the slider, and one section is shown"):
            assert chosen(driver) == "15 deg"
            driver.find_element("id", "dihedral").send_keys("\ue012")  # arrow left
            assert chosen(driver) == "14.5 deg"
            shown = driver.execute_script("return document.querySelectorAll('section.point:not([hidden])').length")
            assert shown == 1
        with subtests.test("matrices, modes, trim and drawing are those of the chosen angle"):
            before = driver.execute_script(_DRAWN)
            move_to(driver, AT)
            assert chosen(driver) == f"{AT} deg"
            compare_with_the_command(driver)
            assert driver.execute_script(_DRAWN) != before
        with subtests.test("it fits on eight screens, and a link of the contents unfolds its section"):
            seen_at(driver, 1400)
            assert driver.execute_script("return document.documentElement.scrollHeight") <= 8 * 900
            links = driver.find_elements("css selector", "nav a")
            assert len(links) >= 5
            links[1].click()
            assert settles(driver, "document.querySelector('main > details').open")
            gone = "document.querySelector('.slider').getBoundingClientRect().bottom <= 2"
            assert settles(driver, gone), "the slider stays within its section"
            driver.execute_script("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        with subtests.test("no table and no drawing is wider than the window"):
            for width in (1600, 400):
                seen_at(driver, width)
                assert settles(driver, f"document.documentElement.scrollWidth <= {width}"), width
                assert screenshot(driver, tmp_path / f"page-{width}.png").startswith(b"\x89PNG")
        with subtests.test("text stands out, light and dark"):
            for scheme in ("light", "dark"):
                seen_at(driver, 1600, scheme)
                assert settles(driver, _LEGEND_ABOVE)
                assert min(driver.execute_script(_CONTRAST)) >= 4.5, scheme
                screenshot(driver, tmp_path / f"page-{scheme}.png")
        with subtests.test("headings, headers and texts for those who cannot see"):
            assert_readable(driver)
        with subtests.test("prints to A4"):
            seen_at(driver, 688, medium="print")  # 182 mm between the margins
            wide = "return [...document.querySelectorAll('table')].filter((t) => t.offsetParent)"
            assert max(driver.execute_script(f"{wide}.map((t) => t.getBoundingClientRect().right)")) <= 689
            pdf = driver.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"]
            assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(pdf))) > 4
        with subtests.test("the browser complains of nothing"):
            assert driver.get_log("browser") == []


def compare_with_the_command(driver: Any) -> None:
    """What the page shows at the chosen angle against `hfa linearize` and `hfa trim`."""
    words = ("--dihedral", AT, "--parameters", NAME, "--json")
    model, trim = (json.loads(hfa(name, *words).out) for name in ("linearize", "trim"))
    for letter in ("A", "B"):
        shown = [[float(cell) for cell in row[1:]] for row in driver.execute_script(_ROWS, letter)]
        assert shown == [[pytest.approx(value, abs=5.001e-5) for value in row] for row in model[letter]]
    modes = driver.execute_script(_ROWS, "mode")
    assert [row[0] for row in modes] == [mode["name"] for mode in model["modes"]]
    assert [float(row[2]) for row in modes] == [pytest.approx(mode["damping"], abs=5.001e-5) for mode in model["modes"]]
    inputs = {row[0]: float(row[1]) for row in driver.execute_script(_ROWS, "input")}
    assert inputs["throttle"] == pytest.approx(trim["operating_point"]["inputs"]["throttle"], abs=5.001e-6)
    loads = trim["loads"]
    texts = driver.execute_script(_TEXTS)
    for name in ("outer_lift", "center_lift"):
        assert f"{loads[name]:.1f} lbf" in texts
    assert f"{loads['hinge_moment']:.1f} ft lbf" in texts


def assert_readable(driver: Any) -> None:
    levels = driver.execute_script(
        "return [...document.querySelectorAll('h1,h2,h3,h4,h5')].map((heading) => +heading.tagName[1])"
    )
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    for lacking in (
        "th:not([scope])",
        "img:not([alt])",
        "div.plot:not([aria-label])",
        "table:not(.table > table)",
        "input:not([aria-valuetext])",
    ):
        assert driver.find_elements("css selector", lacking) == [], lacking
    assert driver.execute_script("return document.getElementById('dihedral').labels.length") == 1
    assert driver.find_element("tag name", "html").get_attribute("lang") == "en"
