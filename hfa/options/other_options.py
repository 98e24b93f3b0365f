"""Options of other tools, used in messages on unknown options."""

#: Options that a command does not have -> what to do in their place.
INSTEAD = {
    "hfa solve --discount": "discount is an entry of the plant file (--model FILE)",
    "hfa solve --dt": "dt is an entry of the plant file (--model FILE)",
    "hfa learn --discount": "discount is an entry of the plant file (--model FILE)",
    "hfa learn --dt": "dt is an entry of the plant file (--model FILE)",
    "hfa fly --model": "give the plant by --aircraft FILE",
    "hfa optimize --model": "give the plant by --aircraft FILE",
    "hfa trim --model": "give the plant by --aircraft FILE",
    **{
        f"hfa {command} --{option}": f"levels are on the sheet of hfa trim --{option}"
        for command in ("linearize", "sweep")
        for option in ("class", "category")
    },
    "hfa regenerate --dihedral": "matrices of other angles are those of hfa linearize --dihedral "
    "DEG",
    "hfa assess --policy": "give the deployment file alone: hfa assess FILE.toml",
    "hfa verify --policy": "give the policy by --weights FILE",
    "hfa assess --law": "laws that plan are compared by hfa optimize --law NAME --starts N",
    "hfa prove region --law": "a region is proved for a gain or a critic (--weights FILE), and for "
    "no policy that plans",
}
#: Each row: an option that a command lacks, and options that it may mean.
_TABLE = """
--input: --command
--lateral: --states
--longitudinal: --states
--step: --command
--doublet: --command
--time: --duration
--format: --output
--save: --output
--csv: --output
--si: --units
--set: --hold
--fix: --hold
--param: --hold
--range: --hold
--wind: --gust --turbulence
--episodes: --samples
--verbose: --full
--seconds: --duration
--x0: --initial --start
--initial: --start
--schedule: --controller
--gains: --controller --weights
--k: --weights
--gain: --weights
--gamma: --delta --hold
--critic: --weights
--model: --aircraft
--plant: --model --aircraft
--file: --aircraft
--plot: --picture
--figure: --picture
--alpha: --hold
--alt: --hold
--altitude: --hold
--angle: --dihedral
--mach: --hold
--speed: --hold
--theta: --hold
--velocity: --hold
"""
#: Option of another tool -> options that it may mean.
MEANINGS = {
    word: names.split() for word, names in (row.split(": ") for row in _TABLE.split("\n")[1:-1])
}
#: Option -> what it means here, where it is mistaken for something else.
NOTES = {"--hold": "such as --hold speed=70"}
