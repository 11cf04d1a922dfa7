"""A dataset's card on the Hugging Face Hub: what it is, whether anything in it was measured, and how to get it."""

import json
from collections import Counter
from pathlib import Path, PurePosixPath

from millisight.core import read_json
from millisight.core.errors import DamagedFileError
from millisight.datasets._manifest import MANIFEST_NAME, Manifest
from millisight.io.mito import IMAGE, INFO

CARD_NAME = "README.md"
_SIMULATOR = "simulator of the paper: point reflectors"
_MEASURED = "measured, or made by others"
_SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"), (10**7, "1M<n<10M"))
_GET = """\
## Get it

```sh
pip install "millisight[hub]"
millisight dataset download {name} --repo {repository}
millisight dataset verify {name}
```

`{manifest}` lists every file with its SHA-256, which `verify` compares. Pickles are read without running code.
"""


def hub_card(folder: Path, manifest: Manifest, repository: str, licence: str | None) -> str:
    """The card: what the hub reads, as YAML, then the dataset's own card, then how to get it.

    Parameters
    ----------
    folder : the dataset's
    manifest : its manifest
    repository : owner/name
    licence : its name on the hub, such as "cc-by-4.0"; None: unknown

    Raises
    ------
    DamagedFileError
        A description of an experiment is not JSON.
    """
    name = repository.rpartition("/")[2]
    origins = _origins(folder, manifest)
    images = sum(entry.kind == IMAGE for entry in manifest.entries.values())
    measured = _MEASURED in origins
    simulated = "partly" if measured and len(origins) > 1 else not measured
    front = {
        "license": licence or "unknown",
        "pretty_name": manifest.settings.get("recipe", name),
        "size_categories": [next((text for limit, text in _SIZES if images < limit), "n>10M")],
        "task_categories": ["image-segmentation", "image-classification"],
        "tags": ["radar", "millimeter-wave", "synthetic-aperture-radar", "millisight",
                 *(["simulated"] if simulated else [])],
        "viewer": False,
        "simulated": simulated,
        "physics": sorted(set(origins) - {_MEASURED}),
        "made_by": _made_by(manifest),
    }  # fmt: skip
    yaml = "".join(f"{key}: {json.dumps(value)}\n" for key, value in front.items())  # JSON is YAML
    own = folder / CARD_NAME
    body = own.read_text(encoding="utf-8", errors="replace") if own.exists() else _body(name, origins, manifest)
    return (
        f"---\n{yaml}---\n\n{body.rstrip()}\n\n{_GET.format(name=name, repository=repository, manifest=MANIFEST_NAME)}"
    )


def _made_by(manifest: Manifest) -> str:
    told = manifest.settings
    if "recipe" in told:
        follow = "the job.json below truth/ hold all that the files follow from"
        return f"millisight generate, recipe {told['recipe']!r}, seed {told['seed']}; {follow}"
    return "millisight dataset convert"


def _origins(folder: Path, manifest: Manifest) -> Counter[str]:
    """How many experiments and simulations there are of each origin: a physics, or measured."""
    found: Counter[str] = Counter()
    simulations = set()
    for path, entry in manifest.entries.items():
        parts = PurePosixPath(path).parts
        if "simulation" in parts[:-1]:
            simulations.add(parts[: parts.index("simulation") + 2])
        elif entry.kind == INFO:
            told = _info(folder / path)
            found[str(told.get("physics", "simulated")) if told.get("simulated") is True else _MEASURED] += 1
    if simulations:
        found[_SIMULATOR] = len(simulations)
    return found


def _info(path: Path) -> dict[str, object]:
    try:
        told = read_json(path)
    except (OSError, ValueError, RecursionError) as error:
        raise DamagedFileError(f"{path.name} of {path.parent.name} cannot be read: {error}") from error
    return told if isinstance(told, dict) else {}


def _body(name: str, origins: Counter[str], manifest: Manifest) -> str:
    """What a converted dataset says of itself."""
    if _MEASURED in origins:
        said = "What was simulated, and what was not, is in the table."
    else:
        said = "**Everything here is simulated. Nothing was measured.**"
    lines = ["| origin | experiments and simulations |", "|---|---|"]
    lines += [f"| {origin} | {count} |" for origin, count in sorted(origins.items())]
    size = sum(entry.size for entry in manifest.entries.values())
    return (
        f"# {name}\n\n{said} Converted to HDF5 by millisight from the layout of the published MITO dataset.\n\n"
        + "\n".join(lines)
        + f"\n\n{len(manifest.entries)} files, {size / 1e6:.1f} MB.\n"
    )
