"""Catalog of JSBSim's built-in properties, from `properties.json`.

`python -m hfa_jsbsim.catalog` writes this file from the installed package jsbsim. It lists the
properties of small test aircraft with engines of all kinds, whose files define no properties.
"""

from __future__ import annotations

import json
import re
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

DATA = Path(__file__).with_name("properties.json")
_PLACE = '<location unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>'
_TABLE = "<table name='{}' type='internal'> <tableData> 0 1\n 1 1\n </tableData> </table>"
_GRID = (
    "<table name='{}' type='internal'> <tableData>   0 1\n 0 1 1\n 1 1 1\n </tableData> </table>"
)
_PROPELLER = (
    "<propeller version='1.1'> <ixx> 1 </ixx> <diameter unit='FT'> 6 </diameter> <minpitch> 10"
    " </minpitch> <maxpitch> 30 </maxpitch> <minrpm> 600 </minrpm> <maxrpm> 2500 </maxrpm>"
    f" {_GRID.format('C_THRUST')} {_GRID.format('C_POWER')} </propeller>"
)
#: Kind of engine -> content of its element, and its thruster.
_ENGINES = {
    "turbine_engine": (
        "<milthrust> 1000 </milthrust> <augmented> 1 </augmented> <augmethod> 1 </augmethod>"
        " <injected> 1 </injected> <function name='IdleThrust'> <v>0.1</v> </function>"
        " <function name='MilThrust'> <v>1</v> </function>",
        "<direct/>",
    ),
    "rocket_engine": (
        "<isp> 200 </isp> <propflowmax> 5 </propflowmax>",
        "<nozzle> <area> 1 </area> </nozzle>",
    ),
    "piston_engine": (
        "<maxhp> 200 </maxhp> <numboostspeeds> 1 </numboostspeeds> <ratedboost1> 5 </ratedboost1>"
        " <ratedpower1> 200 </ratedpower1> <ratedrpm1> 2500 </ratedrpm1>",
        _PROPELLER,
    ),
    "turboprop_engine": (
        "<milthrust> 1000 </milthrust> <maxpower> 500 </maxpower>"
        f" {_GRID.format('EnginePowerRPM_N1')} {_TABLE.format('ITT_N1')}"
        f" {_TABLE.format('EnginePowerVC')} {_TABLE.format('CombustionEfficiency_N1')}",
        _PROPELLER,
    ),
    "electric_engine": ("<power unit='WATTS'> 1000 </power>", _PROPELLER),
}
_AIRCRAFT = """<fdm_config name="small" version="2.0">
<metrics> <wingarea unit="FT2"> 100 </wingarea> <wingspan unit="FT"> 20 </wingspan>
 <chord unit="FT"> 5 </chord> <location name="AERORP" unit="IN"> <x> 0 </x> </location> </metrics>
<mass_balance> <ixx> 100 </ixx> <iyy> 100 </iyy> <izz> 100 </izz> <emptywt> 1000 </emptywt>
 <location name="CG" unit="IN"> <x> 0 </x> </location>
 <pointmass name="load"> <weight unit="LBS"> 10 </weight> {place} </pointmass> </mass_balance>
<ground_reactions> <contact type="BOGEY" name="wheel"> {place}
 <static_friction> 1 </static_friction> <dynamic_friction> 1 </dynamic_friction>
 <rolling_friction> 0 </rolling_friction> <spring_coeff unit="LBS/FT"> 100 </spring_coeff>
 <damping_coeff unit="LBS/FT/SEC"> 10 </damping_coeff> <max_steer unit="DEG"> 5 </max_steer>
 <brake_group> NONE </brake_group> <retractable> 1 </retractable> </contact> </ground_reactions>
<external_reactions> <force name="push" frame="BODY"> {place}
 <direction> <x> 1 </x> <y> 0 </y> <z> 0 </z> </direction> </force> </external_reactions>
<propulsion> <engine> <feed> 0 </feed> <{kind}> {engine} </{kind}>
 <thruster> {place} {thruster} </thruster> </engine>
 <tank type="FUEL"> {place} <capacity unit="LBS"> 100 </capacity>
 <contents unit="LBS"> 50 </contents> </tank> </propulsion>
<flight_control name="FCS"/>
<aerodynamics/>
</fdm_config>
"""
#: Number of an engine, tank or wheel in a name.
_NUMBER = re.compile(r"\[\d+\]")
#: Names that the files of these small aircraft define.
_OWN = ("IdleThrust", "MilThrust", "push/")

#: Properties that a file may set in JSBSim, but that its catalog does not list.
_UNLISTED = (
    *("atmosphere/override/temperature", "atmosphere/override/pressure"),
    "atmosphere/override/density",
)
#: Suffixes of names that JSBSim defines for components: failures, and whether a limit is reached.
_OF_COMPONENTS = (
    *("/malfunction/fail_zero", "/malfunction/fail_hardover", "/malfunction/fail_stuck"),
    *("/malfunction/fail_low", "/malfunction/fail_high", "/saturated"),
    "/initial-integrator-value",
)


@lru_cache
def _properties() -> dict[str, str]:
    """Return name of a built-in property -> its access rights, "R", "RW" or "W"."""
    data: dict[str, Any] = json.loads(DATA.read_text())
    return data["properties"]


def access(name: str) -> str:
    """Return the access rights "R", "RW" or "W" of a built-in JSBSim property, "" for other names.

    Numbers of engines, tanks and wheels in the name are ignored.
    """
    if of_component(name):
        return "RW"
    return _properties().get(without_numbers(name), "")


def of_component(name: str) -> bool:
    """Return whether a property has a name that JSBSim gives to values of a control component."""
    return name.endswith(_OF_COMPONENTS)


def without_numbers(name: str) -> str:
    """Return the name of a property without the numbers of engines, tanks and wheels."""
    return _NUMBER.sub("", name)


def main() -> int:
    """Write `properties.json` from the installed package jsbsim."""
    import jsbsim

    found: dict[str, str] = dict.fromkeys(_UNLISTED, "W")
    for kind, (engine, thruster) in _ENGINES.items():
        with tempfile.TemporaryDirectory() as root:
            folder = Path(root) / "aircraft" / "small"
            folder.mkdir(parents=True)
            text = _AIRCRAFT.format(kind=kind, engine=engine, thruster=thruster, place=_PLACE)
            (folder / "small.xml").write_text(text)
            simulator = jsbsim.FGFDMExec(root)
            simulator.set_debug_level(0)
            simulator.load_model("small")
            simulator["ic/vt-fps"] = 200.0
            simulator["ic/h-sl-ft"] = 5000.0
            simulator.run_ic()
            for line in simulator.query_property_catalog("").split("\n"):
                name, _, rights = line.strip().partition(" ")
                if name and not any(own in name for own in _OWN):
                    found[without_numbers(name)] = rights.strip("()")
    data = {"jsbsim": jsbsim.__version__, "properties": dict(sorted(found.items()))}
    DATA.write_text(json.dumps(data, indent=0) + "\n")
    print(f"{DATA}: {len(found)} properties of JSBSim {jsbsim.__version__}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
