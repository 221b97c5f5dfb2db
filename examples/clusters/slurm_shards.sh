#!/bin/bash
# Compare on a Slurm cluster without a scheduler of Dask: a job array of sixteen shards.
#
#   array=$(sbatch --parsable examples/clusters/slurm_shards.sh paper_human results/paper_human)
#   sbatch --dependency=afterany:$array --wrap "causal-openlock report results/paper_human"
#
# A shard that was killed is started again with `sbatch --array=3 ...`; those that are done end at
# once. `causal-openlock status results/paper_human` shows how all of them stand.
#SBATCH --job-name=shard
#SBATCH --array=1-16
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=4
#SBATCH --mem-per-cpu=2G
#SBATCH --time=24:00:00
#SBATCH --requeue
set -euo pipefail
experiment=$1
out=$2       # a folder that all nodes share
shards=16    # as many as the array has jobs, and the same each time

srun causal-openlock compare "$experiment" --out "$out" \
    --shard "${SLURM_ARRAY_TASK_ID}/${shards}" --workers "${SLURM_CPUS_PER_TASK}"
