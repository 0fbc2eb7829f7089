"""``roadstate estimators``, ``manoeuvres`` and ``vehicles``: what there is, one line each."""

from __future__ import annotations

from roadstate.cli import options


def estimators(as_json: options.AsJson = False) -> None:
    """List the estimators and the channels each needs."""
    from roadstate.cli.console import console, print_json, table
    from roadstate.estimators import all_estimators

    found = all_estimators()
    if as_json:
        print_json(
            {
                name: {
                    "summary": e.summary,
                    "needs": [{"what": n.what, "alternatives": n.alternatives} for n in e.needs],
                    "optional": e.optional,
                }
                for name, e in found.items()
            }
        )
        return
    rows = table(
        "name", "what it is", "needs", left=("name", "what it is", "needs"), wrap=("what it is", "needs")
    )
    for name, e in found.items():
        rows.add_row(name, e.summary, ", ".join(need.what for need in e.needs))
    console().print(rows)


def manoeuvres(as_json: options.AsJson = False) -> None:
    """List the manoeuvres that can be simulated."""
    from roadstate.cli.console import console, print_json, table
    from roadstate.sim.manoeuvres import all_manoeuvres

    found = all_manoeuvres()
    if as_json:
        print_json(
            {
                name: {"summary": m.summary, "source": m.source, "speed": m.speed, "friction": m.friction}
                for name, m in found.items()
            }
        )
        return
    rows = table("name", "km/h", "friction", "what it is", left=("name", "what it is"), wrap=("what it is",))
    for name, m in found.items():
        rows.add_row(name, f"{3.6 * m.speed:.0f}", f"{m.friction:g}", m.summary)
    console().print(rows)


def vehicles(as_json: options.AsJson = False) -> None:
    """List the vehicles that '--vehicle' knows by name."""
    from dataclasses import asdict

    from roadstate.cli.console import console, print_json, table
    from roadstate.vehicles import presets

    found = presets()
    if as_json:
        print_json({name: asdict(v) for name, v in found.items()})
        return
    rows = table(
        "name", "mass kg", "driven", "what it is", left=("name", "driven", "what it is"), wrap=("what it is",)
    )
    for name, v in found.items():
        rows.add_row(name, f"{v.mass:.0f}", v.driven, v.description)
    console().print(rows)
