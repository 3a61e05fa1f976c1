#!/bin/sh
# Puts promtool and prometheus, which some tests use and are skipped without, into a folder (.venv/bin).
# They come from the package of Debian or Ubuntu; nothing is installed or started, and root is not needed.
set -eu
into=$(realpath "${1:-.venv/bin}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
apt-get download -qq prometheus
dpkg-deb -x prometheus_*.deb .
cp usr/bin/promtool usr/bin/prometheus "$into"
"$into/promtool" --version
# Tests of whole clusters and images need more, which is installed (as root), not started:
#     apt-get install slurmctld slurmd slurm-client munge buildah debootstrap
#     .venv/bin/pip install kubernetes-validate      # and kubectl 1.22 or later
