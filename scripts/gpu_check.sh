#!/usr/bin/env bash
# Check a GPU's pictures against the CPU's and measure it: scripts/gpu_check.sh [DEVICE] [options of gpu_check.py]
# Needs the GPU's own OpenCL (NVIDIA and Intel: with the driver, AMD: ROCm) or PoCL's CUDA device.
set -euo pipefail

root="$(cd "$(dirname "$0")/.." && pwd)"
python="${PYTHON:-$root/.venv/bin/python}"
if ! command -v "$python" >/dev/null; then
  echo "gpu_check.sh: $python is missing; 'make lint' sets it up, or PYTHON names another with tfm_cl" >&2
  exit 2
fi
"$python" -m tfm_cl devices >&2
exec "$python" "$root/scripts/gpu_check.py" "$@"
