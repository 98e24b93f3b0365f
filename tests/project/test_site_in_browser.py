"""The site of `make docs` in a browser: nothing is cut off at common window widths."""

import subprocess
import sys

import pytest
from chromium import browser, set_page_width
from project import ROOT

WIDTHS = (1000, 1400, 1920)
#: Script that returns the first words of each code box and table that is wider than its space, and
#: whether the page is wider than the window.
_CUT = """const boxes = 'article pre, article table, article .table, article .table-wrapper';
  const cut = [...document.querySelectorAll(boxes)]
    .filter((box) => box.scrollWidth > box.clientWidth)
    .map((box) => box.textContent.trim().slice(0, 60));
  if (document.documentElement.scrollWidth > window.innerWidth) cut.push('the page');
  return cut"""


def cut_boxes(driver, page, width):
    """Return the texts of the boxes that are cut off on a page of this width in pixels."""
    set_page_width(driver, width)
    driver.get(page.as_uri())
    return driver.execute_script(_CUT)


@pytest.mark.slow
def test_no_box_of_the_site_is_cut_off(tmp_path):
    """No code box or table of the site is wider than its space in windows of 1000 to 1920 px, and
    no page is wider than the window.
    """
    pytest.importorskip("sphinx", reason="needs sphinx: pip install '.[dev]'")
    with browser() as driver:
        site = tmp_path / "site"
        words = [sys.executable, "-m", "sphinx", "-q", str(ROOT / "docs"), str(site)]
        subprocess.run(words, check=True, cwd=ROOT)
        pages = [page for page in site.rglob("*.html") if "_modules" not in page.parts]
        assert len(pages) > 30
        cut = {
            f"{page.relative_to(site)} at {width} px": boxes
            for page in pages
            for width in WIDTHS
            if (boxes := cut_boxes(driver, page, width))
        }
        assert cut == {}
