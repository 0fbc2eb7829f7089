"""The Magic Formula once more, naively: scalars, ``math`` only, one quantity a line, nothing shared.

Written from the equations of Pacejka, *Tire and Vehicle Dynamics*, 3rd ed., (4.E1)–(4.E78), and for 5.2 and
PAC2002 from those of the 1st ed. (which MF-Tyre 5.2 follows). ISO-W axes, no turn slip, above VXLOW.
"""

from __future__ import annotations

import re
from math import acos, atan, cos, exp, hypot, pi, sin, sqrt, tan
from pathlib import Path
from typing import NamedTuple

ONES = """LFZO LCX LMUX LEX LKX LHX LVX LGAX LCY LMUY LEY LKY LKYC LKZC LHY LVY LGAY LTR LRES LGAZ LXAL LYKA
LVYKA LS LSGKP LSGAL LMX LVMX LMY RCX1 RCY1 QSY7"""


class Coefficients(dict[str, float]):
    """A coefficient that is not there is 0, a scale factor 1."""

    def __missing__(self, key: str) -> float:
        return 1.0 if key in ONES.split() else 2.0 if key == "PKY4" else 0.0


class Point(NamedTuple):
    """Angles in rad with ISO signs; ``lmu`` replaces LMUX and LMUY."""

    kappa: float
    alpha: float
    gamma: float
    Fz: float
    pressure: float
    lmu: float
    V: float


Answer = tuple[float, float, float, float, float]
"""F_x, F_y, M_x, M_y, M_z."""


def coefficients(path: Path) -> Coefficients:
    found = re.findall(r"^\s*([A-Z0-9_]+)\s*=\s*([-+0-9.eE]+)", path.read_text("latin-1"), re.MULTILINE)
    return Coefficients({key: float(value) for key, value in found})


def sgn(x: float) -> float:
    return float(x > 0) - float(x < 0)


def mf61(p: Coefficients, at: Point) -> Answer:
    """MF 6.1 with the weighting functions."""
    kappa, alpha, gamma, Fz, pressure, lmu, V = at
    lmux = lmuy = lmu
    R0, Fz0 = p["UNLOADED_RADIUS"], p["FNOMIN"]
    Fz0p = p["LFZO"] * Fz0  # 4.E1
    dfz = (Fz - Fz0p) / Fz0p  # 4.E2a
    dpi = (pressure - p["NOMPRES"]) / p["NOMPRES"]  # 4.E2b
    a = tan(alpha)  # 4.E3
    g = sin(gamma)  # 4.E4
    lmuxp = 10 * lmux / (1 + 9 * lmux)  # 4.E8
    lmuyp = 10 * lmuy / (1 + 9 * lmuy)

    # longitudinal, pure
    SHx = (p["PHX1"] + p["PHX2"] * dfz) * p["LHX"]  # 4.E17
    kx = kappa + SHx  # 4.E10
    Cx = p["PCX1"] * p["LCX"]  # 4.E11
    mux = (
        (p["PDX1"] + p["PDX2"] * dfz)
        * (1 + p["PPX3"] * dpi + p["PPX4"] * dpi**2)
        * (1 - p["PDX3"] * g**2)
        * lmux
    )
    Dx = mux * Fz  # 4.E12
    Ex = min(
        1, (p["PEX1"] + p["PEX2"] * dfz + p["PEX3"] * dfz**2) * (1 - p["PEX4"] * sgn(kx)) * p["LEX"]
    )  # 4.E14
    Kxk = (
        Fz * (p["PKX1"] + p["PKX2"] * dfz) * exp(p["PKX3"] * dfz) * (1 + p["PPX1"] * dpi + p["PPX2"] * dpi**2)
    )
    Kxk *= p["LKX"]  # 4.E15
    Bx = Kxk / (Cx * Dx)  # 4.E16
    SVx = Fz * (p["PVX1"] + p["PVX2"] * dfz) * p["LVX"] * lmuxp  # 4.E18
    Fx0 = Dx * sin(Cx * atan(Bx * kx - Ex * (Bx * kx - atan(Bx * kx)))) + SVx  # 4.E9

    # lateral, pure; once with camber and once without
    def Fy0_(g: float) -> tuple[float, ...]:
        Cy = p["PCY1"] * p["LCY"]  # 4.E21
        muy = (
            (p["PDY1"] + p["PDY2"] * dfz)
            * (1 + p["PPY3"] * dpi + p["PPY4"] * dpi**2)
            * (1 - p["PDY3"] * g**2)
            * lmuy
        )
        Dy = muy * Fz  # 4.E22
        peak = (p["PKY2"] + p["PKY5"] * g**2) * (1 + p["PPY2"] * dpi)
        Kya = p["PKY1"] * Fz0p * (1 + p["PPY1"] * dpi) * (1 - p["PKY3"] * abs(g))
        Kya *= sin(p["PKY4"] * atan(Fz / Fz0p / peak)) * p["LKY"]  # 4.E25
        By = Kya / (Cy * Dy)  # 4.E26
        SVyg = Fz * (p["PVY3"] + p["PVY4"] * dfz) * g * p["LKYC"] * lmuyp  # 4.E28
        Kyg0 = Fz * (p["PKY6"] + p["PKY7"] * dfz) * (1 + p["PPY5"] * dpi) * p["LKYC"]  # 4.E30
        SHy = (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"] + (Kyg0 * g - SVyg) / Kya  # 4.E27
        SVy = Fz * (p["PVY1"] + p["PVY2"] * dfz) * p["LVY"] * lmuyp + SVyg  # 4.E29
        ay = a + SHy  # 4.E20
        Ey = (p["PEY1"] + p["PEY2"] * dfz) * (1 + p["PEY5"] * g**2 - (p["PEY3"] + p["PEY4"] * g) * sgn(ay))
        Ey = min(1, Ey * p["LEY"])  # 4.E24
        force = Dy * sin(Cy * atan(By * ay - Ey * (By * ay - atan(By * ay)))) + SVy  # 4.E19
        return force, muy, Kya, By, Cy, SHy, SVy

    Fy0, muy, Kya, By, Cy, SHy, SVy = Fy0_(g)

    # combined
    SHxa = p["RHX1"]
    aS = a + SHxa
    Bxa = (p["RBX1"] + p["RBX3"] * g**2) * cos(atan(p["RBX2"] * kappa)) * p["LXAL"]
    Cxa, Exa = p["RCX1"], min(1, p["REX1"] + p["REX2"] * dfz)
    Gxa0 = cos(Cxa * atan(Bxa * SHxa - Exa * (Bxa * SHxa - atan(Bxa * SHxa))))
    Gxa = cos(Cxa * atan(Bxa * aS - Exa * (Bxa * aS - atan(Bxa * aS)))) / Gxa0
    Fx = Gxa * Fx0
    SHyk = p["RHY1"] + p["RHY2"] * dfz
    kS = kappa + SHyk
    Byk = (p["RBY1"] + p["RBY4"] * g**2) * cos(atan(p["RBY2"] * (a - p["RBY3"]))) * p["LYKA"]
    Cyk, Eyk = p["RCY1"], min(1, p["REY1"] + p["REY2"] * dfz)
    Gyk0 = cos(Cyk * atan(Byk * SHyk - Eyk * (Byk * SHyk - atan(Byk * SHyk))))
    Gyk = cos(Cyk * atan(Byk * kS - Eyk * (Byk * kS - atan(Byk * kS)))) / Gyk0
    DVyk = muy * Fz * (p["RVY1"] + p["RVY2"] * dfz + p["RVY3"] * g) * cos(atan(p["RVY4"] * a))
    SVyk = DVyk * sin(p["RVY5"] * atan(p["RVY6"] * kappa)) * p["LVYKA"]
    Fy = Gyk * Fy0 + SVyk

    # aligning moment
    Bt = (
        (p["QBZ1"] + p["QBZ2"] * dfz + p["QBZ3"] * dfz**2)
        * (1 + p["QBZ4"] * g + p["QBZ5"] * abs(g))
        * p["LKY"]
        / lmuy
    )
    Ct = p["QCZ1"]
    Dt = Fz * R0 / Fz0 * (p["QDZ1"] + p["QDZ2"] * dfz) * (1 - p["PPZ1"] * dpi)
    Dt *= (1 + p["QDZ3"] * g + p["QDZ4"] * g**2) * p["LTR"]
    a_t = a + p["QHZ1"] + p["QHZ2"] * dfz + (p["QHZ3"] + p["QHZ4"] * dfz) * g
    Et = p["QEZ1"] + p["QEZ2"] * dfz + p["QEZ3"] * dfz**2
    Et = min(1, Et * (1 + (p["QEZ4"] + p["QEZ5"] * g) * 2 / pi * atan(Bt * Ct * a_t)))
    ar = a + SHy + SVy / Kya
    ateq = sqrt(a_t**2 + (Kxk / Kya) ** 2 * kappa**2) * sgn(a_t)
    areq = sqrt(ar**2 + (Kxk / Kya) ** 2 * kappa**2) * sgn(ar)
    t = Dt * cos(Ct * atan(Bt * ateq - Et * (Bt * ateq - atan(Bt * ateq)))) * cos(alpha)
    Br = p["QBZ9"] * p["LKY"] / lmuy + p["QBZ10"] * By * Cy
    camber = (p["QDZ8"] + p["QDZ9"] * dfz) * (1 + p["PPZ2"] * dpi) + (p["QDZ10"] + p["QDZ11"] * dfz) * abs(g)
    Dr = Fz * R0 * ((p["QDZ6"] + p["QDZ7"] * dfz) * p["LRES"] + camber * g * p["LKZC"]) * lmuy * cos(alpha)
    Mzr = Dr * cos(atan(Br * areq))
    s = R0 * (p["SSZ1"] + p["SSZ2"] * Fy / Fz0 + (p["SSZ3"] + p["SSZ4"] * dfz) * g) * p["LS"]
    Mz = -t * Gyk * Fy0_(0.0)[0] + Mzr + s * Fx
    return Fx, Fy, overturning(p, Fz, Fy, g, dpi), rolling(p, Fz, Fx, g, pressure, V), Mz


def mf52(p: Coefficients, at: Point, ellipse: bool) -> Answer:
    """MF 5.2 and PAC2002, with the friction ellipse or the weighting functions."""
    kappa, alpha, gamma, Fz, pressure, lmu, V = at
    lmux = lmuy = lmu
    R0, Fz0 = p["UNLOADED_RADIUS"], p["FNOMIN"]
    Fz0p = p["LFZO"] * Fz0
    dfz = (Fz - Fz0p) / Fz0p
    gx, gy, gz = gamma * p["LGAX"], gamma * p["LGAY"], gamma * p["LGAZ"]

    SHx = (p["PHX1"] + p["PHX2"] * dfz) * p["LHX"]
    kx = kappa + SHx
    Cx = p["PCX1"] * p["LCX"]
    Dx = (p["PDX1"] + p["PDX2"] * dfz) * (1 - p["PDX3"] * gx**2) * lmux * Fz
    Ex = min(1, (p["PEX1"] + p["PEX2"] * dfz + p["PEX3"] * dfz**2) * (1 - p["PEX4"] * sgn(kx)) * p["LEX"])
    Kx = Fz * (p["PKX1"] + p["PKX2"] * dfz) * exp(p["PKX3"] * dfz) * p["LKX"]
    Bx = Kx / (Cx * Dx)
    SVx = Fz * (p["PVX1"] + p["PVX2"] * dfz) * p["LVX"] * lmux
    Fx0 = Dx * sin(Cx * atan(Bx * kx - Ex * (Bx * kx - atan(Bx * kx)))) + SVx

    SHy = (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"] + p["PHY3"] * gy
    ay = alpha + SHy
    Cy = p["PCY1"] * p["LCY"]
    Dy = (p["PDY1"] + p["PDY2"] * dfz) * (1 - p["PDY3"] * gy**2) * lmuy * Fz
    Ey = min(1, (p["PEY1"] + p["PEY2"] * dfz) * (1 - (p["PEY3"] + p["PEY4"] * gy) * sgn(ay)) * p["LEY"])
    Ky = p["PKY1"] * Fz0p * sin(2 * atan(Fz / (p["PKY2"] * Fz0p))) * (1 - p["PKY3"] * abs(gy)) * p["LKY"]
    By = Ky / (Cy * Dy)
    SVy = Fz * ((p["PVY1"] + p["PVY2"] * dfz) * p["LVY"] + (p["PVY3"] + p["PVY4"] * dfz) * gy) * lmuy
    Fy0 = Dy * sin(Cy * atan(By * ay - Ey * (By * ay - atan(By * ay)))) + SVy

    if ellipse:
        beta = acos(abs(kx) / hypot(kx, tan(ay)))
        act_x, act_y = abs(Fx0 - SVx) / Fz, abs(Fy0 - SVy) / Fz
        max_x, max_y = abs(Dx) / Fz, abs(Dy) / Fz
        mu_x = 1 / sqrt((1 / act_x) ** 2 + (tan(beta) / max_y) ** 2)
        mu_y = tan(beta) / sqrt((1 / max_x) ** 2 + (tan(beta) / act_y) ** 2)
        Fx = mu_x / act_x * Fx0
        Fy = mu_y / act_y * Fy0
        SVyk = 0.0
    else:
        Bxa = p["RBX1"] * cos(atan(p["RBX2"] * kappa)) * p["LXAL"]
        Cxa, Exa, SHxa = p["RCX1"], min(1, p["REX1"] + p["REX2"] * dfz), p["RHX1"]
        aS = alpha + SHxa
        Fx = Fx0 * cos(Cxa * atan(Bxa * aS - Exa * (Bxa * aS - atan(Bxa * aS))))
        Fx /= cos(Cxa * atan(Bxa * SHxa - Exa * (Bxa * SHxa - atan(Bxa * SHxa))))
        Byk = p["RBY1"] * cos(atan(p["RBY2"] * (alpha - p["RBY3"]))) * p["LYKA"]
        Cyk, Eyk, SHyk = p["RCY1"], min(1, p["REY1"] + p["REY2"] * dfz), p["RHY1"] + p["RHY2"] * dfz
        kS = kappa + SHyk
        Gyk = cos(Cyk * atan(Byk * kS - Eyk * (Byk * kS - atan(Byk * kS))))
        Gyk /= cos(Cyk * atan(Byk * SHyk - Eyk * (Byk * SHyk - atan(Byk * SHyk))))
        DVyk = Dy * (p["RVY1"] + p["RVY2"] * dfz + p["RVY3"] * gamma) * cos(atan(p["RVY4"] * alpha))
        SVyk = DVyk * sin(p["RVY5"] * atan(p["RVY6"] * kappa)) * p["LVYKA"]
        Fy = Gyk * Fy0 + SVyk

    a_t = alpha + p["QHZ1"] + p["QHZ2"] * dfz + (p["QHZ3"] + p["QHZ4"] * dfz) * gz
    ar = alpha + SHy + SVy / Ky
    Bt = (p["QBZ1"] + p["QBZ2"] * dfz + p["QBZ3"] * dfz**2) * (1 + p["QBZ4"] * gz + p["QBZ5"] * abs(gz))
    Bt *= p["LKY"] / lmuy
    Ct = p["QCZ1"]
    Dt = Fz * (p["QDZ1"] + p["QDZ2"] * dfz) * (1 + p["QDZ3"] * gz + p["QDZ4"] * gz**2) * R0 / Fz0 * p["LTR"]
    Et = p["QEZ1"] + p["QEZ2"] * dfz + p["QEZ3"] * dfz**2
    Et = min(1, Et * (1 + (p["QEZ4"] + p["QEZ5"] * gz) * 2 / pi * atan(Bt * Ct * a_t)))
    ateq = atan(sqrt(tan(a_t) ** 2 + (Kx / Ky) ** 2 * kappa**2)) * sgn(a_t)
    areq = atan(sqrt(tan(ar) ** 2 + (Kx / Ky) ** 2 * kappa**2)) * sgn(ar)
    t = Dt * cos(Ct * atan(Bt * ateq - Et * (Bt * ateq - atan(Bt * ateq)))) * cos(alpha)
    Br = p["QBZ9"] * p["LKY"] / lmuy + p["QBZ10"] * By * Cy
    Dr = Fz * R0 * ((p["QDZ6"] + p["QDZ7"] * dfz) * p["LRES"] + (p["QDZ8"] + p["QDZ9"] * dfz) * gz) * lmuy
    Mzr = Dr * cos(atan(Br * areq)) * cos(alpha)
    s = R0 * (p["SSZ1"] + p["SSZ2"] * Fy / Fz0 + (p["SSZ3"] + p["SSZ4"] * dfz) * gamma) * p["LS"]
    Mz = -t * (Fy - SVyk) + Mzr + s * Fx
    return Fx, Fy, overturning(p, Fz, Fy, gamma, 0.0), rolling(p, Fz, Fx, gamma, pressure, V), Mz


def overturning(p: Coefficients, Fz: float, Fy: float, g: float, dpi: float) -> float:
    R0, Fz0 = p["UNLOADED_RADIUS"], p["FNOMIN"]
    peak = cos(p["QSX5"] * atan((p["QSX6"] * Fz / Fz0) ** 2))
    wave = sin(p["QSX7"] * g + p["QSX8"] * atan(p["QSX9"] * Fy / Fz0))
    bracket = p["QSX1"] * p["LVMX"] - p["QSX2"] * g * (1 + p["PPMX1"] * dpi) + p["QSX3"] * Fy / Fz0
    bracket += p["QSX4"] * peak * wave + p["QSX10"] * atan(p["QSX11"] * Fz / Fz0) * g
    extra = Fy * (p["QSX13"] + p["QSX14"] * abs(g)) - Fz * p["QSX12"] * g * abs(g)
    return R0 * Fz * bracket * p["LMX"] + R0 * p["LMX"] * extra


def rolling(p: Coefficients, Fz: float, Fx: float, g: float, pressure: float, V: float) -> float:
    R0, Fz0, V0 = p["UNLOADED_RADIUS"], p["FNOMIN"], p["LONGVL"]
    bracket = p["QSY1"] + p["QSY2"] * Fx / Fz0 + p["QSY3"] * abs(V / V0) + p["QSY4"] * (V / V0) ** 4
    bracket += (p["QSY5"] + p["QSY6"] * Fz / Fz0) * g**2
    result = -R0 * Fz0 * p["LMY"] * bracket * (Fz / Fz0) ** p["QSY7"]
    return result * (pressure / p["NOMPRES"]) ** p["QSY8"] if p["QSY8"] else result
