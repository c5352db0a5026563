"""Pin the development environment: resolve all extras of setup.py and print every version.

Run by `make lock`; its output is requirements/development.txt, which `make` installs.
"""

import json
import subprocess
import sys
from pathlib import Path

EXTRAS = "ros,evaluation,test,development"
HEADER = """\
# Everything that `make` installs, each version pinned. Written by `make lock` from the extras of
# setup.py: change those, not this file.
"""


def resolved_versions(project: Path) -> dict[str, str]:
    """Name and version of each package that an empty environment would need from the index."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run"]
    command += ["--ignore-installed", "--report", "-", f"{project}[{EXTRAS}]"]
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    return {
        item["metadata"]["name"].lower().replace("_", "-"): item["metadata"]["version"]
        for item in report["install"]
        if "dir_info" not in item["download_info"]
    }


if __name__ == "__main__":
    versions = resolved_versions(Path(__file__).resolve().parent.parent)
    print(HEADER + "\n".join(f"{name}=={versions[name]}" for name in sorted(versions)))
