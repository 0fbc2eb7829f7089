"""``roadstate simulate``: a drive of the reference plant, as a log with the truth in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadstate.cli import options

if TYPE_CHECKING:
    from roadstate.sim.plant import Plant
    from roadstate.sim.run import Drive
    from roadstate.vehicles import Vehicle

_RATE = 200.0  # of the truth that the sensors sample, Hz
_PLANTS = ("multibody", "seven-dof", "three-dof")


def simulate(
    manoeuvre: Annotated[
        str,
        typer.Argument(
            metavar="MANOEUVRE", help="What to drive (see 'roadstate manoeuvres').", show_default=False
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Log to write: .csv, .parquet or .mf4.", show_default=False
        ),
    ],
    vehicle: options.VehicleName = "family-car",
    road: Annotated[
        Path | None,
        typer.Option("--road", metavar="FILE", help="Road (YAML or OpenCRG) in place of the manoeuvre's."),
    ] = None,
    friction: Annotated[
        float | None,
        typer.Option("--friction", metavar="MU", help="Peak friction of the (better) surface."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", metavar="KMH", help="Default: the manoeuvre's usual one.")
    ] = None,
    noise: Annotated[
        str, typer.Option("--noise", metavar="PRESET", help="Sensors: ideal, paper, automotive or worn.")
    ] = "automotive",
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of the sensors' noise.")] = 0,
    plant: Annotated[
        str, typer.Option("--plant", metavar="NAME", help="multibody, seven-dof or three-dof.")
    ] = "multibody",
    tir: Annotated[
        Path | None,
        typer.Option("--tir", metavar="FILE", help="Tire property file for the multibody plant."),
    ] = None,
    mismatch: Annotated[
        list[str] | None,
        typer.Option(
            "--mismatch",
            metavar="NAME=PERCENT",
            help="The car that drives is off the vehicle file by this, as mass=10; may be repeated.",
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Drive a manoeuvre in simulation; write what sensors record.

    The log has canonical channels at 100 Hz and the truth beside them (ref_friction_fl, ref_force_y_rl,
    ref_grade …), ready for 'roadstate estimate' and 'roadstate compare'. The same seed gives the same log.
    """
    from roadstate.cli.console import console, print_json, table, text
    from roadstate.cli.progress import working
    from roadstate.core import InputError
    from roadstate.core.channels import did_you_mean
    from roadstate.core.numerics import use_compilation_cache
    from roadstate.io import write
    from roadstate.sim.manoeuvres import KMH
    from roadstate.sim.manoeuvres import manoeuvre as find
    from roadstate.sim.plant.mismatch import mismatched
    from roadstate.sim.roads import load_road, uniform
    from roadstate.sim.run import drive, record
    from roadstate.sim.sensors import sensor_preset, to_log
    from roadstate.vehicles import load_vehicle

    if plant not in _PLANTS:
        raise InputError(f"no plant is called '{plant}'", mend=did_you_mean(plant, _PLANTS))
    if tir is not None and plant != "multibody":
        raise InputError("--tir is for the multibody plant", mend="leave out --tir or --plant")
    suite, car, off = sensor_preset(noise), load_vehicle(vehicle), _percents(mismatch or [])
    real = mismatched(car, **off)
    use_compilation_cache()
    given = None if speed is None else speed * KMH
    task = find(manoeuvre).prepare(car, speed=given, friction=friction)
    if road is not None:
        task = task.on(load_road(road))
        if friction is not None:
            task = task.with_friction(uniform(friction))
    with working() as work:
        work.begin(f"driving {manoeuvre}")
        driven = drive(_plant(plant, real, tir), task, car, rate=_RATE)
        work.begin("writing")
        settings = {"vehicle": vehicle, "plant": plant, "noise": noise, "seed": seed, "mismatch": off}
        log = to_log(record(driven, suite, seed=seed, metadata=settings))
        write(log, out)
    facts = _facts(driven)
    if as_json:
        print_json({"log": str(out), "manoeuvre": manoeuvre, **settings, "samples": len(log), **facts})
        return
    screen = console()
    screen.print(text(f"{manoeuvre}: {task.description}"))
    rows = table("duration s", "distance m", "speed km/h", "largest |a_y| m/s²", "largest |a_x| m/s²", "used")
    rows.add_row(
        f"{facts['duration']:.1f}",
        f"{facts['distance']:.0f}",
        f"{facts['speed_least'] / KMH:.0f} to {facts['speed_most'] / KMH:.0f}",
        f"{facts['accel_y_most']:.1f}",
        f"{facts['accel_x_most']:.1f}",
        f"{100 * facts['friction_used_most']:.0f}%",
    )
    screen.print(rows)
    screen.print(text("used: largest share of its friction that a wheel takes, for 0.1 s or longer."))
    screen.print(text(f"log: {out}"), soft_wrap=True)
    again = f"roadstate compare {out} --vehicle {vehicle}"
    screen.print(text(f"estimators on it: {again}"), soft_wrap=True)


def _percents(given: list[str]) -> dict[str, float]:
    from inspect import signature

    from roadstate.core import InputError
    from roadstate.core.channels import did_you_mean
    from roadstate.sim.plant.mismatch import mismatched

    known = list(signature(mismatched).parameters)[1:]
    found = {}
    for word in given:
        name, _, percent = word.partition("=")
        if name not in known:
            raise InputError(
                f"no figure is called '{name}'", where="--mismatch", mend=did_you_mean(name, known)
            )
        try:
            found[name] = float(percent)
        except ValueError as error:
            raise InputError(
                f"'{percent}' is no number", where="--mismatch", mend=f"write {name}=10 for 10 %"
            ) from error
    return found


def _plant(name: str, car: Vehicle, tir: Path | None) -> Plant:
    from roadstate.sim.plant import multibody_plant
    from roadstate.sim.plant.planar import PlanarPlant

    if name == "multibody":
        return multibody_plant(car, tir=tir)
    return PlanarPlant.seven_dof(car) if name == "seven-dof" else PlanarPlant.three_dof(car)


def _facts(driven: Drive) -> dict[str, float]:
    """What a person wants to know of a drive, in SI."""
    import numpy as np

    truth = driven.truth
    speed = np.linalg.norm(truth.velocity, axis=1)
    load = np.asarray(truth.load)
    used = np.hypot(truth.force_x, truth.force_y) / np.maximum(np.asarray(truth.friction) * load, 1.0)
    used = np.where(load > 0.05 * load.mean(), used, 0.0)
    lasting = np.lib.stride_tricks.sliding_window_view(used, round(0.1 * _RATE), axis=0).min(axis=-1)
    return {
        "duration": float(driven.time[-1]),
        "distance": float(np.sum(speed[:-1] * np.diff(driven.time))),
        "speed_least": float(speed.min()),
        "speed_most": float(speed.max()),
        "accel_x_most": float(np.abs(truth.specific_force[:, 0]).max()),
        "accel_y_most": float(np.abs(truth.specific_force[:, 1]).max()),
        "friction_used_most": float(min(lasting.max(), 1.0)),
    }
