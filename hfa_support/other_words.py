"""Synonyms in other tools and books, used in messages on unknown names."""

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
#: Each row: a word in lower case, and names in this project that it may mean, with _ for -.
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
s: wing_area
sref: wing_area
b: span
bref: span
c: chord
cbar: chord
cref: chord
w: weight
cla: cl_alpha
cda: cd_alpha
cma: cm_alpha
cyb: cy_beta
clb: cl_beta
cnb: cn_beta
cmadot: cm_alphadot
cladot: cl_alphadot
clde: cl_elevator
cmde: cm_elevator
clda: cl_aileron
cnda: cn_aileron
cldr: cl_rudder
cndr: cn_rudder
cydr: cy_rudder
bode: linearize
care: solve
check: verify
evaluate: verify assess
dare: solve
linmod: linearize
lqr: solve
modes: linearize
poles: eigenvalues linearize
riccati: solve
rlocus: sweep
rollout: fly
root_locus: sweep
step: fly
train: learn
angle: dihedral
--alpha: --hold
--alt: --hold
--altitude: --hold
--angle: --dihedral
--mach: --hold
--speed: --hold
--theta: --hold
--velocity: --hold
aoa: alpha
bank: phi roll
derivatives: rates_at
dynamics: rates_at
eig: eigenvalues linearize
fpa: path_angle gamma
gamma: path_angle flight_path_angle delta discount
h: altitude
m: mach
n: load_factor
nz: load_factor
n_z: load_factor
find_operating_point: trim
findop: trim
describe: report
summary: report
sheet: report
info: report
print: report
head: to_pandas
to_json: save
passed: ok
predict: u
act: u
c2d: sampled
discretize: sampled
excess: cost_lost
result: ok
errors: checks
damping: modes
step_response: step
f: rates_at
x: states
statespace: linearmodel
make: environment
gym: environment
lower: min
upper: max
gain: k
functions: basis
interp: at
load_aircraft: load_model
from_matrix: from_value
make_env: environment
p: roll_rate
phi: roll bank
pitch: theta
psi: yaw heading
q: pitch_rate
r: yaw_rate
reduce: select
residual: residuals certificate
reward: cost
sel: at
simulate: fly
ss: linearmodel
t: time
tas: speed
theta: pitch
to_csv: save
v: speed
velocity: speed
x0: initial
initial_state: initial
initial_states: initial
seconds: duration
start: initial
vt: speed
zeta: damping modes
wn: frequency modes
success: ok
converged: ok settled
"""
#: Name -> what it means here, where it is mistaken for something else.
NOTES = {"initial": "deviation from the trim", "--hold": "such as --hold speed=70"}
#: Word of another tool -> names in this project that it may mean.
MEANINGS = {
    word: names.split()
    for word, names in (line.split(": ") for line in _TABLE.strip().replace("-", "_").splitlines())
}
