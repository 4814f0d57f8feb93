"""In a clone, the way to the package ``wt_gym.agents``, which stands in the folder ``agents`` beside ``wt_gym``.

A wheel has the package itself here (``setup.py``), and this file is not in it. Whichever way the package is found, its
modules have the same names, so that what one process pickles another one can load. A symbolic link would do the same
only where the file system and the settings of git allow one.
"""

import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # a checker of types does not follow the way

    def __getattr__(name: str) -> Any: ...


_folder = Path(__file__).resolve().parents[2] / "agents"
_spec = importlib.util.spec_from_file_location(
    __name__, _folder / "__init__.py", submodule_search_locations=[str(_folder)]
)
if _spec is None or _spec.loader is None or not _folder.is_dir():
    raise ModuleNotFoundError(f"wt_gym.agents must be in {_folder}, and there is no such folder", name=__name__)
_package = importlib.util.module_from_spec(_spec)
sys.modules[__name__] = _package  # the import gives what stands here when this file ends
_spec.loader.exec_module(_package)
