# Shared by tools/test and tools/demo, which source it: a virtual environment of the checkout's
# own, the package in it, and Mesa's OpenGL. Everything is looked at first and left alone where it
# is there already, so a second run costs a second and needs no network.
# shellcheck shell=bash

unset CDPATH PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX PIP_REQUIRE_VIRTUALENV
cd -P -- "$(dirname -- "${BASH_SOURCE[0]}")/.." || exit 1
exec </dev/null # nothing here asks questions

readonly VENV="$PWD/.venv"

say() { printf '%s\n' "$*"; }

fail() {
    printf '%s\n' "$*" >&2
    exit 1
}

# quietly COMMAND...: its output is shown only where it fails.
quietly() {
    local log status
    log=$(mktemp) || exit 1
    "$@" >"$log" 2>&1
    status=$?
    [ "$status" -eq 0 ] || cat -- "$log" >&2
    rm -f -- "$log"
    return "$status"
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo -n "$@"; fi
}

can_install() {
    command -v apt-get >/dev/null && as_root true 2>/dev/null
}

# apt_install PACKAGE...: from a fresh list; the list may be partly out of reach, apt then says so
# when a package is missing.
apt_install() {
    local apt=(env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o DPkg::Lock::Timeout=300)
    as_root "${apt[@]}" update >/dev/null 2>&1
    quietly as_root "${apt[@]}" install --no-install-recommends "$@"
}

# --- Python

suits() { # PYTHON
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

find_python() {
    local candidate
    for candidate in ${GLVIS_PYTHON:+"$GLVIS_PYTHON"} \
        python3 python3.13 python3.12 python3.11 python3.14 /usr/bin/python3; do
        if command -v "$candidate" >/dev/null && suits "$candidate"; then
            command -v "$candidate"
            return 0
        fi
    done
    return 1
}

make_venv() {
    local python version
    if ! python=$(find_python); then
        # Ubuntu 22.04 comes with 3.10 and has 3.11 beside it.
        if can_install; then
            say "Installing Python 3.11 with apt."
            apt_install python3.11 python3.11-venv
        fi
        python=$(find_python) || fail "Python 3.11 or newer is needed; install it," \
            "for example with: apt-get install python3.11 python3.11-venv"
    fi
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        if can_install; then
            say "Installing python$version-venv with apt."
            apt_install "python$version-venv" || apt_install python3-venv
        fi
        "$python" -c 'import ensurepip, venv' 2>/dev/null ||
            fail "$python cannot make virtual environments; install: apt-get install python$version-venv"
    fi
    say "Making a virtual environment in .venv with Python $version."
    rm -rf -- "$VENV"
    quietly "$python" -m venv "$VENV" || fail "$python could not make a virtual environment in $VENV"
}

venv_works() { # not where its Python is gone, nor where the checkout has moved since
    [ -x "$VENV/bin/python" ] &&
        suits "$VENV/bin/python" &&
        "$VENV/bin/python" -m pip --version >/dev/null 2>&1 &&
        [ "$(cat -- "$VENV/glvis-home" 2>/dev/null || printf %s "$VENV")" = "$VENV" ]
}

# install_package [EXTRA]: the checkout, editable, again only where pyproject.toml has changed.
install_package() {
    local extra="${1-}" stamp="$VENV/glvis-installed${1:+-$1}" wanted
    venv_works || make_venv
    printf %s "$VENV" >"$VENV/glvis-home"
    wanted=$(cksum <pyproject.toml)
    if [ "$(cat -- "$stamp" 2>/dev/null)" = "$wanted" ]; then
        return 0
    fi
    say "Installing glvis and what it needs into .venv; the first time takes a minute."
    quietly "$VENV/bin/python" -m pip install --disable-pip-version-check --no-input \
        -e ".${extra:+[$extra]}" || fail "pip could not install glvis, see above"
    printf %s "$wanted" >"$stamp"
    printf %s "$wanted" >"$VENV/glvis-installed" # every extra holds the plain package
}

# --- OpenGL

install_opengl() {
    local packages=(libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri)
    "$VENV/bin/python" tools/has_egl.py >/dev/null 2>&1 && return 0
    if can_install; then
        say "Installing Mesa's OpenGL with apt (${packages[*]})."
        apt_install "${packages[@]}"
    fi
    "$VENV/bin/python" tools/has_egl.py && return 0
    fail "no OpenGL without a display on this machine; install: apt-get install ${packages[*]}"
}
