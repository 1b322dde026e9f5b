"""The page of the documentation that the command writes: page.md, filled in."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from public_cases.measured import STEP
from public_cases.ours import BY_EXPERIMENT, COLUMNS, UNIFORM, UNIFORM_STRAIN, spelled
from public_cases.tables import Table
from sixflow.engine.threads import worker_count
from sixflow.version import __version__

TEMPLATE = Path(__file__).with_name("page.md")

Figures = dict[str, tuple[str, str]]


def write_page(
    path: Path, tables: list[Table], figures: Figures, folder: Path | None, extra: dict[str, dict[str, Any]]
) -> None:
    """Write the page to a file.

    Parameters
    ----------
    figures : dict
        File name and caption of each set's figure, as drawn into `folder`.
    extra : dict
        Columns asked for on the command line.
    """
    results = [table.markdown() for table in tables]
    if figures and folder is not None:
        place = Path(os.path.relpath(folder, path.parent)).as_posix()
        results.append("## Figures\n")
        results += [
            f"{name}. {caption}\n\n![{name}]({place}/{file})\n" for name, (file, caption) in figures.items()
        ]
    page = TEMPLATE.read_text(encoding="utf-8")
    fillings = {
        "version": __version__,
        "processors": str(worker_count()),
        "step": str(STEP),
        "settings": "\n".join(_settings_rows(extra)),
        "results": "\n".join(results),
    }
    for name, text in fillings.items():
        page = page.replace("{" + name + "}", text)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8")


def _settings_rows(extra: dict[str, dict[str, Any]]) -> list[str]:
    cells = {name: f"`{spelled(options)}`" for name, options in (COLUMNS | extra).items()}
    cells["by experiment"] = "; ".join(
        f"{name}: `{spelled(options)}`" for name, options in BY_EXPERIMENT.items()
    )
    cells[UNIFORM] = f"DIC, motion affine: `{spelled(UNIFORM_STRAIN)}`"
    return [f"| {name} | {cell} |" for name, cell in cells.items()]
