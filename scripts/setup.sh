# Sourced by scripts/demo and scripts/test: a virtual environment with everything installed, made once.
# Needs python3 >= 3.11 with venv and pip. PYTHON names another interpreter.

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

set_up() {
    local python=${PYTHON:-python3} stamp=.venv/.set-up want
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        echo "error: $python is not Python 3.11 or newer; set PYTHON to one that is" >&2
        return 1
    fi
    want=$(cat pyproject.toml constraints.txt | cksum)
    if [[ -f $stamp && $(<"$stamp") == "$want" ]]; then
        return
    fi
    echo "setting up .venv (once; some hundred MB, PyTorch among them) ..."
    rm -f "$stamp"
    "$python" -m venv .venv
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
        --editable '.[train,test,tune]'
    echo "$want" >"$stamp"
    echo "set up in ${SECONDS} s"
}

SECONDS=0
set_up
