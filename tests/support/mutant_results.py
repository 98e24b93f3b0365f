"""What `make mutants` found, as a file of results and as the table of docs/promises.md."""

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

_DOCS = Path(__file__).parents[2] / "docs"
FILE, PAGE = _DOCS / "results" / "mutants.json", _DOCS / "promises.md"
_HEADER = "| package | mutants | found by a test | share |"
#: What a survivor is until somebody has looked at it.
OPEN = "not looked at"


def record(outcomes: dict[str, dict[str, Any]], known: dict[str, Any]) -> dict[str, Any]:
    """Counts of a package, and the survivors with the cause that `known` (an earlier record) gives them."""
    packages: dict[str, dict[str, int]] = {}
    for each in sorted(outcomes.values(), key=lambda one: str(one["module"])):
        counts = packages.setdefault(each["module"].partition("/")[0], {"mutants": 0, "killed": 0})
        counts["mutants"] += 1
        counts["killed"] += each["killed"]
    causes = {each["key"]: (each["cause"], each["reason"]) for each in known.get("survivors", [])}
    survivors = []
    for key, each in sorted(outcomes.items(), key=lambda one: (one[1]["module"], one[1]["function"])):
        if not each["killed"]:
            cause, reason = causes.get(key, (OPEN, ""))
            what = {name: each[name] for name in ("module", "function", "change")}
            survivors.append({"key": key, **what, "cause": cause, "reason": reason})
    return {"packages": packages, "survivors": survivors}


def reasoned() -> set[str]:
    """The keys of survivors that somebody has looked at."""
    known = json.loads(FILE.read_bytes())["survivors"] if FILE.exists() else []
    return {each["key"] for each in known if each["reason"]}


def written(outcomes: dict[str, dict[str, Any]]) -> None:
    """Bring the file of results and the page up to date; the causes in the file stay."""
    from hfa_model.support.jsonable import records_text  # here: the forks must load what they need of a copy

    known = json.loads(FILE.read_bytes()) if FILE.exists() else {}
    found = record(outcomes, known)
    FILE.write_text(records_text(found), encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_table(text, found), encoding="utf-8")


def with_table(text: str, found: dict[str, Any]) -> str:
    """The page with its two tables made anew; what stands before and behind them stays."""
    begin = text.index(_HEADER)
    behind = re.compile(r"\n\n(?!\|)").search(text, begin)
    return text[:begin] + table(found) + (text[behind.start() :] if behind else "\n")


def table(found: dict[str, Any]) -> str:
    """The table of the page: how many of each package, and why the others were not found."""
    packages = {**found["packages"]}
    packages["all"] = {name: sum(each[name] for each in packages.values()) for name in ("mutants", "killed")}
    rows = [_HEADER, "|---|---|---|---|"]
    for name, each in packages.items():
        rows.append(f"| {name} | {each['mutants']} | {each['killed']} | {each['killed'] / each['mutants']:.1%} |")
    rows += ["", "| not found, because | mutants |", "|---|---|"]
    rows += [
        f"| {cause} | {count} |" for cause, count in Counter(one["cause"] for one in found["survivors"]).most_common()
    ]
    return "\n".join(rows)
