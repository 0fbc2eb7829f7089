"""The coefficients of the standard Magic Formula: names, defaults, and which of them break symmetry."""

from __future__ import annotations

_ZERO = """
PCX1 PDX1 PDX2 PDX3 PEX1 PEX2 PEX3 PEX4 PKX1 PKX2 PKX3 PHX1 PHX2 PVX1 PVX2 PPX1 PPX2 PPX3 PPX4
RBX1 RBX2 RBX3 REX1 REX2 RHX1
PCY1 PDY1 PDY2 PDY3 PEY1 PEY2 PEY3 PEY4 PEY5 PKY1 PKY2 PKY3 PKY5 PKY6 PKY7 PHY1 PHY2 PHY3
PVY1 PVY2 PVY3 PVY4 PPY1 PPY2 PPY3 PPY4 PPY5
RBY1 RBY2 RBY3 RBY4 REY1 REY2 RHY1 RHY2 RVY1 RVY2 RVY3 RVY4 RVY5 RVY6
QBZ1 QBZ2 QBZ3 QBZ4 QBZ5 QBZ9 QBZ10 QDZ1 QDZ2 QDZ3 QDZ4 QDZ6 QDZ7 QDZ8 QDZ9 QDZ10 QDZ11
QEZ1 QEZ2 QEZ3 QEZ4 QEZ5 QHZ1 QHZ2 QHZ3 QHZ4 PPZ1 PPZ2 SSZ1 SSZ2 SSZ3 SSZ4
QSX1 QSX2 QSX3 QSX4 QSX5 QSX6 QSX7 QSX8 QSX9 QSX10 QSX11 QSX12 QSX13 QSX14 PPMX1
QSY1 QSY2 QSY3 QSY4 QSY5 QSY6 QSY8
PTX1 PTX2 PTX3 PTY1 PTY2
LONGITUDINAL_STIFFNESS LATERAL_STIFFNESS PCFX1 PCFX2 PCFX3 PCFY1 PCFY2 PCFY3
FNOMIN UNLOADED_RADIUS
"""

_ONE = """
RCX1 RCY1 QCZ1 QSY7
LFZO LCX LMUX LEX LKX LHX LVX LXAL LGAX LCY LMUY LEY LKY LKYC LKZC LHY LVY LGAY LTR LRES LGAZ LYKA LVYKA LS
LSGKP LSGAL LMX LVMX LMY
"""

DEFAULTS: dict[str, float] = {
    **dict.fromkeys(_ZERO.split(), 0.0),
    **dict.fromkeys(_ONE.split(), 1.0),
    # sin(p_Ky4 arctan ·) with 2 is the form of MF 5.2, which has no such coefficient
    "PKY4": 2.0,
    "NOMPRES": 2.0e5,
    "INFLPRES": 2.0e5,
    "LONGVL": 16.7,
    "VXLOW": 1.0,
}
"""Every coefficient the model reads, with its value where a file does not give it (SI)."""

MANDATORY = ("FNOMIN", "UNLOADED_RADIUS", "PCX1", "PDX1", "PKX1", "PCY1", "PDY1", "PKY1", "PKY2")
"""Without these there is no force."""

ALIASES = {
    "LFZ0": "LFZO",
    "LMR": "LRES",
    "LXA": "LXAL",
    "LYK": "LYKA",
    "LVYK": "LVYKA",
    "LKYG": "LKYC",
    "QPZ1": "PPZ1",
    "QPZ2": "PPZ2",
    "QPX1": "PPMX1",
    "IP": "INFLPRES",
    "IP_NOM": "NOMPRES",
}
"""Other spellings in use → ours."""

ASYMMETRIC = (
    *("PHX1", "PHX2", "PVX1", "PVX2"),  # a force without slip
    *("PHY1", "PHY2", "PVY1", "PVY2", "PEY3"),  # ply steer, conicity
    *("RHX1", "RBY3", "RVY1", "RVY2"),  # combined slip that knows left from right
    *("QHZ1", "QHZ2", "QDZ6", "QDZ7", "QEZ4", "QBZ4", "QDZ3", "SSZ1", "QSX1"),  # the moments
)
"""Zero in a tire that is its own mirror image and pulls nowhere without slip."""
