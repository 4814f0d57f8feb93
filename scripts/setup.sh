# Sourced by scripts/demo, scripts/docs and scripts/test: a virtual environment, made once. EXTRAS names the extras that
# are needed, by default all of them; an environment with all serves everything. Needs python3 >= 3.11 with venv and
# pip. PYTHON names another interpreter.
#
# .venv/.set-up says what the environment was made for, and where: a clone that was moved or copied, or has other
# requirements, is brought up to date in place, which needs no network where nothing new is required. During the set-up
# the file says so: an interrupted one is repeated from the start.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# bytecode of what is used, where it is installed, instead of all that is installed, which takes pip as long as the rest
compile_used() {
    PYTHONDONTWRITEBYTECODE='' .venv/bin/python - gymnasium numba optuna plotly.graph_objects pytest sb3_contrib \
        scipy.optimize scipy.signal scipy.spatial.transform stable_baselines3 torch.utils.tensorboard xarray <<'END'
import importlib.util, sys

for name in sys.argv[1:]:
    if importlib.util.find_spec(name.partition(".")[0]):
        importlib.import_module(name)
END
}

# The CPU build, which needs no GPU packages of several gigabytes; where its index is out of reach, whatever build the
# usual ones have. TORCH_INDEX names another index.
install_torch() {
    install --no-deps --retries 0 --extra-index-url "${TORCH_INDEX:-https://download.pytorch.org/whl/cpu}" torch
}

install() {
    .venv/bin/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt "$@"
}

set_up() {
    local python=${PYTHON:-python3} stamp=.venv/.set-up found='' made all=train,test,tune,docs
    local extras=${EXTRAS:-$all}
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        echo "error: $python is not Python 3.11 or newer; set PYTHON to one that is" >&2
        return 1
    fi
    made="$(cat pyproject.toml constraints.txt | cksum) in $PWD with"
    [[ ! -f $stamp ]] || found=$(<"$stamp")
    if [[ $found == "$made $extras" || $found == "$made $all" ]] && .venv/bin/python -c '' 2>/dev/null; then
        return
    fi
    echo "setting up .venv (once; PyTorch is the largest part) ..."
    if [[ $found == unfinished ]]; then
        rm -rf .venv
        found=''
    fi
    mkdir -p .venv
    # one that was whole is brought up to date again, where that fails for want of a network
    if [[ -n $found ]]; then echo outdated; else echo unfinished; fi >"$stamp"
    "$python" -m venv .venv
    # the build runs in the environment itself: another one would be downloaded each time. moviepy comes as a source
    # archive, which setuptools before 70.1 builds only beside the package wheel
    install 'setuptools>=70.1' 'hatchling>=1.27'
    install_torch
    install --no-build-isolation --editable ".[$extras]"
    if [[ $extras == "$all" ]]; then
        # its library and its input files; its tuning tools would bring some hundred MB more
        install --no-deps 'rosco>=2.10,<3'
    fi
    compile_used
    echo "$made $extras" >"$stamp"
    echo "set up in ${SECONDS} s"
}

SECONDS=0
set_up
