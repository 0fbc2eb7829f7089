"""How JAX is set up for the whole package. Imported before any array is made."""

from __future__ import annotations

import os
from pathlib import Path

import jax

# float64 is the default here: a grade from two nearly equal accelerations wants the digits. Whoever sets
# JAX_ENABLE_X64 decides for themselves.
if "JAX_ENABLE_X64" not in os.environ:
    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]


def use_compilation_cache(folder: str | Path | None = None) -> Path | None:
    """Keep compiled programs on disk, so that only a program's first run ever waits for the compiler.

    Args:
        folder: where; default ``$ROADSTATE_CACHE``, else ``roadstate`` in the user's cache folder. An empty
            ``$ROADSTATE_CACHE`` turns the cache off.

    Returns:
        The folder in use, or ``None`` where the cache is off or the folder cannot be made.
    """
    chosen = folder if folder is not None else os.environ.get("ROADSTATE_CACHE", _default_folder())
    if not str(chosen):
        return None
    path = Path(chosen)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    jax.config.update("jax_compilation_cache_dir", str(path))  # type: ignore[no-untyped-call]
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # type: ignore[no-untyped-call]
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)  # type: ignore[no-untyped-call]
    return path


def _default_folder() -> str:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return str(Path(base) / "roadstate" / "jax")
