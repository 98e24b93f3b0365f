"""Version of the program, and its identity. `pyproject.toml` reads the version from this module.

Importing this module is faster than reading the metadata of the installation.
"""

from functools import cache

VERSION = "0.4.0"
#: Packages of the distribution, of which extensions may be missing.
PACKAGES = (
    *("controller", "hfa", "hfa_aircraft", "hfa_model", "hfa_support", "trim", "verification"),
    *("hfa_daveml", "hfa_flight", "hfa_fmu", "hfa_identify", "hfa_jsbsim", "hfa_page", "hfa_prove"),
)


@cache
def identity() -> str:
    """Return the version with a hash of the installed sources, "0.4.0+1f3c5a7b9d0e".

    Resumable results, certificates and the provenance of files record it, and workers are compared
    with it: other code may compute other numbers. The files are read when the process first asks,
    in about 30 ms.
    """
    import hashlib
    import os
    from importlib.util import find_spec

    digest = hashlib.sha256()
    for package in PACKAGES:
        spec = find_spec(package)
        if spec is None or spec.origin is None:
            continue
        top = os.path.dirname(spec.origin)
        for folder, folders, names in os.walk(top):
            folders[:] = sorted({*folders} - {"__pycache__"})
            for name in sorted(name for name in names if not name.startswith(".")):
                path = os.path.join(folder, name)
                with open(path, "rb") as file:
                    content = file.read()
                where = os.path.relpath(path, top).replace(os.sep, "/")
                digest.update(f"{package}/{where} {len(content)}\n".encode() + content)
    return f"{VERSION}+{digest.hexdigest()[:12]}"
