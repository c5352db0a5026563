#!/bin/sh
# Creates the virtual environment, or brings it up to date:
# environment.sh DIRECTORY REQUIREMENTS [PYTHON]
#
# Needs Python 3.10 to 3.13 and pip, nothing else. Without PYTHON it takes the first that fits of
# python3.12, python3.11, python3.13, python3.10 and python3.
set -eu
cd "$(dirname "$0")/.."
directory=$1
requirements=$2
requested=${3:-}

fail() {
    echo "error: $*" >&2
    exit 1
}

is_supported() {
    "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}

choose_python() {
    if [ -n "$requested" ]; then
        is_supported "$requested" || fail "PYTHON=$requested is not a Python from 3.10 to 3.13"
        echo "$requested"
        return
    fi
    for candidate in python3.12 python3.11 python3.13 python3.10 python3; do
        if is_supported "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    fail "no Python from 3.10 to 3.13 found as python3.12, python3.11, python3.13, python3.10 or" \
        "python3; install one, or name it: make PYTHON=/path/to/python3.12 ..."
}

create() {
    python=$(choose_python)
    echo "Creating $directory with $("$python" --version)"
    rm -rf "$directory"
    if "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        "$python" -m venv "$directory"
    elif "$python" -c 'import pip, venv' 2>/dev/null; then
        # Debian and Ubuntu split ensurepip off into python3-venv; the installed pip does as well.
        "$python" -m venv --without-pip "$directory"
        "$python" -m pip --python "$directory/bin/python" install --quiet pip
    else
        fail "$python can create no virtual environment: it has neither ensurepip nor pip" \
            "(Debian and Ubuntu: apt install python3-venv)"
    fi
}

began=$(date +%s)
lap() {
    echo "  $(($(date +%s) - began)) s"
    began=$(date +%s)
}

if ! is_supported "$directory/bin/python" || ! "$directory/bin/python" -m pip --version >/dev/null
then
    create
    lap
fi
echo "Installing $(grep -c '==' "$requirements") packages of $requirements into $directory"
# uv takes a quarter of pip's time. It does not read pip's configuration: where that names another
# index, uv may find nothing, and pip does the same.
python=$directory/bin/python
if ! { "$python" -m pip install --quiet --disable-pip-version-check \
    "$(grep '^uv==' requirements/development.txt)" &&
    "$python" -m uv pip install --quiet --python "$python" --requirement "$requirements" &&
    "$python" -m uv pip install --quiet --python "$python" --no-deps --editable .; }
then
    echo "uv failed; installing with pip (one to three minutes)"
    # What comes as sources becomes a wheel with every pip, and so a list of its files is left.
    "$python" -m pip install --quiet --disable-pip-version-check --use-pep517 \
        --requirement "$requirements"
    "$python" -m pip install --quiet --disable-pip-version-check --no-deps --editable .
fi
lap
