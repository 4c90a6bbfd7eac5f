#!/usr/bin/env bash
# Runs a small campaign by Snakemake on a Slurm cluster of one node that is started for it, and by
# campaign.py, and compares the tables. Needs root, snakemake, slurm-wlm and munge.
#
#   tests/benchmarks/slurm.sh BIN_DIR [SCENE]     default: desk
#
# Ends with 77 without these.
set -euo pipefail
bin=$(cd "$1" && pwd)
scene=${2:-desk}
accuracy=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../benchmarks/accuracy" && pwd)
for program in snakemake sbatch slurmctld slurmd munged; do
  if ((EUID != 0)) || ! command -v $program > /dev/null; then
    echo "slurm.sh: needs root and $program: skipped" >&2
    exit 77
  fi
done
work=$(mktemp -d)
cluster=$work/cluster
mkdir -p "$cluster"/{control,node} "$work/jobs"
chmod 755 "$work" "$cluster"
daemons=()
finish() {
  for ((i = ${#daemons[@]} - 1; i >= 0; --i)); do
    kill "${daemons[i]}" 2> /dev/null || true
    wait "${daemons[i]}" 2> /dev/null || true
  done
  rm -rf "$work"
}
trap finish EXIT

host=$(hostname -s)
cores=$(nproc)
export SLURM_CONF=$cluster/slurm.conf
cat > "$SLURM_CONF" << EOF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
AuthType=auth/munge
AuthInfo=socket=$cluster/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$cluster/control
SlurmdSpoolDir=$cluster/node
SlurmctldPidFile=$cluster/control.pid
SlurmdPidFile=$cluster/node.pid
SlurmctldLogFile=$cluster/control.log
SlurmdLogFile=$cluster/node.log
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores RealMemory=8000 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
EOF
(umask 077 && head -c 128 /dev/urandom > "$cluster/munge.key")
munged --force --foreground --key-file "$cluster/munge.key" --socket "$cluster/munge.socket" \
  --pid-file "$cluster/munge.pid" --seed-file "$cluster/munge.seed" \
  --log-file "$cluster/munge.log" > /dev/null 2>&1 &
daemons+=($!)
until [[ -S $cluster/munge.socket ]]; do sleep 0.2; done
slurmctld -D > /dev/null 2>&1 &
daemons+=($!)
slurmd -D -N "$host" > /dev/null 2>&1 &
daemons+=($!)
for _ in {1..60}; do
  if [[ $(sinfo -h -o %t 2> /dev/null) == idle ]]; then break; fi
  sleep 1
done
sinfo

campaign=(--bin "$bin" --data "$work" --sequences "$scene" --arms slam off full --seeds 0 1)
"$accuracy/campaign.py" "${campaign[@]}" --output "$work/slurm" --prepare
(cd "$work/jobs" && snakemake -s "$accuracy/Snakefile" --configfile "$work/slurm/campaign.json" \
  --profile "$accuracy/profiles/slurm" --latency-wait 5) > "$work/snakemake.log" 2>&1 || {
  tail -40 "$work/snakemake.log" "$cluster"/*.log
  exit 1
}
tail -3 "$work/snakemake.log"
echo "batch jobs: $(ls "$work"/jobs/slurm-*.log | wc -l)"
"$accuracy/campaign.py" "${campaign[@]}" --output "$work/here" > /dev/null
cat "$work/slurm/tables.md"
# All but what the runs took.
figures() { python3 -c '
import json, sys
runs = json.load(open(sys.argv[1]))["runs"]
print([{k: v for k, v in run.items() if k not in ("wall_s", "peak_mib")} for run in runs])' "$1"; }
[[ $(figures "$work/slurm/tables.json") == "$(figures "$work/here/tables.json")" ]] || {
  echo "slurm.sh: the tables differ" >&2
  exit 1
}
echo "slurm.sh: the same figures as campaign.py"
