"""``roadstate simulate``: a drive of the reference plant, as a log with the truth in it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadstate.cli import options

if TYPE_CHECKING:
    from roadstate.sim.plant import Plant
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
            "--out",
            "-o",
            metavar="FILE",
            parser=options.written,
            help="Log to write: .csv, .parquet or .mf4.",
            show_default=False,
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
    wind: Annotated[
        float,
        typer.Option(
            "--wind",
            metavar="KMH",
            min=-200.0,
            max=200.0,
            help="Steady wind from ahead of the car as it starts; from behind where negative.",
        ),
    ] = 0.0,
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
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="KIND:CHANNEL[:START[:DURATION[:SIZE]]]",
            help="dropout, stuck, spike, drift, sign or time_jump of sensors; may be repeated.",
        ),
    ] = None,
    report: Annotated[
        bool, typer.Option("--report", help="Draw the drive into an HTML page beside the log.")
    ] = False,
    as_json: options.AsJson = False,
) -> None:
    """Drive a manoeuvre in simulation; write what sensors record.

    The log has canonical channels at 100 Hz and the truth beside them (ref_friction_fl, ref_force_y_rl,
    ref_grade …), ready for 'roadstate estimate' and 'roadstate compare'. The same seed gives the same log.
    """
    from roadstate.cli.console import console, print_json, table, text
    from roadstate.cli.errors import require
    from roadstate.cli.logs import stem
    from roadstate.cli.outputs import staged
    from roadstate.cli.progress import working
    from roadstate.cli.simulate_words import faults, percents
    from roadstate.core import InputError
    from roadstate.core.channels import did_you_mean
    from roadstate.core.numerics import use_compilation_cache
    from roadstate.io import write
    from roadstate.io.formats import writer_of
    from roadstate.sim.facts import drive_facts
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
    if wind and plant != "multibody":
        raise InputError("--wind is for the multibody plant", mend="leave out --wind or --plant")
    if report:
        require("bokeh")
    writer_of(out)
    suite, car, off = sensor_preset(noise), load_vehicle(vehicle), percents(mismatch or [])
    real = mismatched(car, **off)
    use_compilation_cache()
    given = None if speed is None else speed * KMH
    task = find(manoeuvre).prepare(car, speed=given, friction=friction)
    if road is not None:
        task = task.on(load_road(road))
        if friction is not None:
            task = task.with_friction(uniform(friction))
    wrong = faults(fault or [], task.duration)
    settings = {
        "vehicle": vehicle,
        "plant": plant,
        "noise": noise,
        "seed": seed,
        "mismatch": off,
        "wind": wind * KMH,
    }
    page = f"{stem(out)}.html" if report else None
    with working() as work:
        work.begin(f"driving {manoeuvre}")
        ahead = float(task.road.at(task.s, task.d).heading)
        blows = (-wind * KMH * math.cos(ahead), -wind * KMH * math.sin(ahead))
        driven = drive(_plant(plant, real, tir, blows), task, car, rate=_RATE)
        work.begin("writing")
        recording = record(driven, suite, seed=seed, faults=wrong, metadata=settings)
        log = to_log(recording)
        with staged(out.parent) as folder:
            write(log, folder / out.name)
            if page is not None:
                from roadstate.report.drive_page import write_drive_page

                told = {"manoeuvre": manoeuvre, **settings, "faults": fault or "none"}
                write_drive_page(folder / page, driven, settings=told)
    facts = drive_facts(driven)
    if as_json:
        named = {} if page is None else {"report": str(out.parent / page)}
        settings["faults"] = recording.metadata.get("faults", [])
        print_json(
            {"log": str(out), **named, "manoeuvre": manoeuvre, **settings, "samples": len(log), **facts}
        )
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
    if page is not None:
        screen.print(text(f"report: {out.parent / page}"), soft_wrap=True)
    again = f"roadstate compare {out} --vehicle {vehicle}"
    screen.print(text(f"estimators on it: {again}"), soft_wrap=True)


def _plant(name: str, car: Vehicle, tir: Path | None, wind: tuple[float, float]) -> Plant:
    from roadstate.sim.plant import multibody_plant
    from roadstate.sim.plant.planar import PlanarPlant

    if name == "multibody":
        return multibody_plant(car, tir=tir, wind=wind)
    return PlanarPlant.seven_dof(car) if name == "seven-dof" else PlanarPlant.three_dof(car)
