#!/bin/bash
# Compare on several machines that are reached over SSH and share a folder.
#
#   examples/clusters/ssh_dask.sh hosts.txt 8 paper_human /shared/results/paper_human
#
# hosts.txt has a host in each line; the scheduler runs on the first one, and 8 workers on each.
# It needs `pip install paramiko` here, and the same Python with causal-openlock[cluster] everywhere.
set -euo pipefail
hosts=$1
workers=$2
experiment=$3
out=$4

# Variables do not travel over SSH, so they stand before the Python that is started there.
settings="DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=0 DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=null"
dask ssh --hostfile "$hosts" --nworkers "$workers" --nthreads 1 --memory-limit 0 \
    --scheduler-port 8786 --remote-python "env $settings ${PYTHON:-python3}" &
cluster=$!
trap 'kill $cluster; wait' EXIT
sleep "${WAIT:-10}"
causal-openlock compare "$experiment" --out "$out" --cluster "tcp://$(head -n 1 "$hosts"):8786"
