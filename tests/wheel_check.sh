#!/bin/sh
# Build the wheel, install it into a fresh environment outside the checkout and use it there.
# Needs the network, or pip's cache, for the build backend and the dependencies: `make wheel-test`.
set -eu

python=${1:-python3}
checkout=$(cd "$(dirname "$0")/.." && pwd)
case $python in
    */*) python=$(cd "$(dirname "$python")" && pwd)/$(basename "$python") ;;
esac
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
export PIP_DISABLE_PIP_VERSION_CHECK=1
unset PYTHONPATH || true

"$python" -m pip wheel -q --no-deps -w "$work/dist" "$checkout"
"$python" - "$work"/dist/navopt-*.whl <<'EOF'
import sys
import zipfile

names = set(zipfile.ZipFile(sys.argv[1]).namelist())
expected = {
    *(f"{package}/{name}" for package in ("navopt", "baselines", "comparisons") for name in ("__init__.py", "py.typed")),
    *(f"navopt/data/free_air_egm2008_d{degree}.nc" for degree in (720, 2190)),
    "navopt/data/SHA256SUMS",
    "navopt/data/LICENSE-EGM2008.txt",
    "navopt/data/PROVENANCE.md",
    "comparisons/studies/gravity-demo.toml",
    "comparisons/templates/report.html.j2",
}
missing = sorted(expected - names)
foreign = sorted(
    name
    for name in names
    if name.partition("/")[0] not in ("navopt", "baselines", "comparisons")
    and ".dist-info/" not in name
    or name.endswith((".pyc", ".nbi", ".nbc"))
)
if missing or foreign:
    sys.exit(f"wheel: missing {missing}, not expected {foreign}")
EOF

"$python" -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q -c "$checkout/constraints.txt" "$work"/dist/navopt-*.whl
cd "$work"
home=$(venv/bin/python -c 'import navopt; print(navopt.__file__)')
case $home in
    */venv/*/site-packages/navopt/__init__.py) ;;
    *) echo "imported from $home, not from the wheel" >&2; exit 1 ;;
esac
venv/bin/navopt --version
venv/bin/navopt list
venv/bin/navopt run gravity-demo --worlds 1 --budget 200
test -s results/gravity-demo/report.html
echo "the wheel works outside the checkout"
