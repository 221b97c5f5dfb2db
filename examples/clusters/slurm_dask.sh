#!/bin/bash
# Compare on a Slurm cluster through Dask: one scheduler, a worker on each of 64 cores, the command.
#
#   sbatch examples/clusters/slurm_dask.sh paper_human results/paper_human
#
# Give the same command again after the job has ended, for whatever reason: it continues where it was.
#SBATCH --job-name=compare
#SBATCH --ntasks=64
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=24:00:00
set -euo pipefail
experiment=$1
out=$2  # a folder that all nodes share

# One thread for each worker, and what the how-to page says about schedulers.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
export DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=0
export DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=null

mkdir -p "$out.dask"
address="$out.dask/scheduler-${SLURM_JOB_ID}.json"
dask scheduler --no-dashboard --port 0 --scheduler-file "$address" &
scheduler=$!
# Slurm limits the memory, so Dask does not have to.
srun dask worker --scheduler-file "$address" --nthreads 1 --nworkers 1 --memory-limit 0 \
    --no-dashboard --local-directory "${TMPDIR:-/tmp}" --death-timeout 60 &
trap 'kill $scheduler; wait' EXIT
until [ -s "$address" ]; do sleep 1; done
tcp=$(python -c 'import json, sys; print(json.load(open(sys.argv[1]))["address"])' "$address")
causal-openlock compare "$experiment" --out "$out" --cluster "$tcp"
