"""Where the NX Nastran superelements are: pyYeti ships them, and they are found without importing it."""

from __future__ import annotations

import importlib.util
from pathlib import Path

PYYETI = Path(importlib.util.find_spec("pyyeti").origin).parent  # type: ignore[union-attr,arg-type]
TRUSS = PYYETI / "tests" / "nas2cam_extseout"
OP4_FILES = sorted((PYYETI / "tests").glob("nas*/*.op4"))

# the solver's own WEIGHTCHECK (7 digits) and the eigenvalues of kxx, mxx: fixed-interface frequencies in Hz, kg-mm-s units
FIXED_INTERFACE_HZ = {
    "outboard": [
        1.6500014346547165, 1.6502494261565313, 1.6742648315077946, 1.6746871244517878, 7.02535050687908, 7.02541124474547,
        10.91273856961068, 10.91454276564493, 13.98577953560541, 13.991720656058131, 25.13473385911838, 25.139945433851626,
        42.17271434224875, 42.19338416804237, 46.71594941829806, 46.894730361931714, 69.17287734886628, 87.50436795093349,
        110.85247827251467, 139.23557995209518, 152.2260611988268, 472.62431732860097,
    ],
    "inboard": [
        6.129345508646885, 6.130134198333572, 23.63187662480853, 70.47544373254995, 70.78509750127164, 104.66535662074912,
        188.03540237016867, 208.59712910210587,
    ],
}  # fmt: skip
MASS = {"outboard": 1.5903838009872422, "inboard": 1.7550518260260166}
CENTER = {
    "outboard": [184.63979671558047, 149.99999999849592, 149.99999999849516],
    "inboard": [1039.9983507210834, 150.0000000003983, 150.0000000009391],
}
INERTIA_DIAGONAL = {
    "outboard": [356932.7347677754, 45158.96721995255, 376328.1479124402],
    "inboard": [35905.2021538635, 368201.2385926915, 368201.2385942261],
}
PRODUCT_YZ = {"outboard": -109.55825715, "inboard": 109.55826057}
