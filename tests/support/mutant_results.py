"""What `make mutants` found, as a file of results and as the table of docs/promises.md."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

FILE = Path(__file__).parents[2] / "docs" / "results" / "mutants.json"
#: What a survivor is until somebody has looked at it.
OPEN = "not looked at"


def record(outcomes: dict[str, dict[str, Any]], known: dict[str, Any]) -> dict[str, Any]:
    """Counts of a package, and the survivors with the cause that `known` (an earlier record) gives them."""
    packages: dict[str, dict[str, int]] = {}
    for each in outcomes.values():
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


def written(outcomes: dict[str, dict[str, Any]], path: Path = FILE) -> None:
    """Bring the file of results up to date; the causes in it stay."""
    known = json.loads(path.read_bytes()) if path.exists() else {}
    path.write_text(json.dumps(record(outcomes, known), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def table(found: dict[str, Any]) -> str:
    """The table of the page: how many of each package, and why the others were not found."""
    packages = {**found["packages"]}
    packages["all"] = {name: sum(each[name] for each in packages.values()) for name in ("mutants", "killed")}
    rows = ["| package | mutants | found by a test | share |", "|---|---|---|---|"]
    for name, each in packages.items():
        rows.append(f"| {name} | {each['mutants']} | {each['killed']} | {each['killed'] / each['mutants']:.1%} |")
    rows += ["", "| not found, because | mutants |", "|---|---|"]
    rows += [
        f"| {cause} | {count} |" for cause, count in Counter(one["cause"] for one in found["survivors"]).most_common()
    ]
    return "\n".join(rows)
