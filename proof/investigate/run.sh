#!/bin/bash
# Effects concealed in the virtual rig that one poor ramp leaves tied, each investigated until one explanation is left,
# and beside it what the same ramp once more would have said: the table of docs/investigate.md, over as many seeds of
# the rig's noise as wanted. Virtual time; about 10 s a case.
#
#   proof/investigate/run.sh OUT [SEED...]      (seeds 1 to 3 when none are given)
#
# OUT/results.tsv holds: concealed, seed, outcome, whether the one that is left is the concealed one, rounds, seconds of rig
# time, what two of the poor recordings together would have named, and what the investigation said. ISORIG names the program (build/bin/isorig).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
export here root ISORIG=${ISORIG:-$root/build/bin/isorig}
(($#)) || { echo "usage: run.sh OUT [SEED...]" >&2; exit 2; }
mkdir -p "$1"
out=$(cd "$1" && pwd)
export out
shift
seeds=("${@:-1}")
(($#)) || seeds=(1 2 3)

# name, force noise in N, effect, numbers
cases() {
  cat <<'END'
delay-20ms 0.05 force_delay delay_s=0.02
lag-20ms 0.05 force_lag time_constant_s=0.02
friction-20mN 0.1 coulomb_friction law="jenkins",force_N=0.02,presliding_mm=0.005
softening-10mN/mm 0.1 cyclic_softening law="elastic",travel_mm=8.0,lost_N_mm=-0.01
softening-3mN/mm 0.1 cyclic_softening law="elastic",travel_mm=8.0,lost_N_mm=-0.003
play-6um 0.1 crosshead_backlash gap_mm=0.006
drift-0.3N/h 0.1 zero_drift law="linear",rate_N_h=0.3
END
}

one() {
  local name=$1 noise_N=$2 effect=$3 numbers=$4 seed=$5
  local folder=$out/${name//\//-per-}-$seed
  rm -rf "$folder" && mkdir -p "$folder"
  { cat "$here/truth.toml"; printf '[[part]]\nphysics = "%s"\n%s\n' "$effect" "${numbers//,/$'\n'}"; } > "$folder/truth.toml"
  sed -e "s#\"\.\./#\"$root/config/#" -e "s/^force_noise_N = .*/force_noise_N = $noise_N/" "$root/config/rigs/sim.toml" > "$folder/rig.toml"
  printf '\n[sim.physics]\nmodel = "truth.toml"\nnominal_pressure_psi = 15.0\n' >> "$folder/rig.toml"
  # 1: not settled within its rounds or budget, which the table says; anything else is a fault.
  local code=0
  "$ISORIG" investigate --rig "$folder/rig.toml" --protocol "$here/poor.toml" --model "$here/nominal.toml" --seed "$seed" \
    --threads 1 --no-report --out "$folder/out" > "$folder/said.txt" 2>&1 || code=$?
  ((code <= 1)) || { cat "$folder/said.txt" >&2; return 1; }
  local record=$folder/out/investigation.json
  local outcome text rig_s rounds right=no
  outcome=$(sed -n 's/^ *"outcome": "\(.*\)",$/\1/p' "$record" | head -1)
  text=$(sed -n 's/^ *"text": "\(.*\)",$/\1/p' "$record" | head -1)
  rig_s=$(sed -n 's/^ *"rig_s": \([0-9]*\).*/\1/p' "$record" | head -1)
  rounds=$(grep -c '"round":' "$record")
  [[ $text == *"stands out: $effect "* ]] && right=yes

  # The same ramp again, with other noise, diagnosed together with the first.
  "$ISORIG" run "$here/poor.toml" --rig "$folder/rig.toml" --runs "$folder/again" --seed $((seed + 1000)) --quiet > "$folder/again.txt"
  "$ISORIG" export "$(find "$folder/again" -mindepth 1 -maxdepth 1 -type d)" --out "$folder/again/recordings" >> "$folder/again.txt"
  "$ISORIG" diagnose "$folder"/out/round-1/recordings/* "$folder"/again/recordings/* --model "$here/nominal.toml" --threads 1 \
    --no-report --out "$folder/again/diagnosis" > "$folder/again.txt"
  local again
  again=$(awk 'NR == 1 { verdict = $1 } $2 == "p" && !n++ { named = $1 " " $4 } END { print verdict == "unknown_physics" ? "unknown" : n ? named : verdict }' "$folder/again.txt")
  printf '%s\t%s\t%s\t%s\t%s\t%s\t%s\t%s\n' "$name" "$seed" "$outcome" "$right" "$rounds" "$rig_s" "$again" "$text" > "$folder/result.tsv"
}
export -f one

cases | while read -r line; do for seed in "${seeds[@]}"; do echo "$line $seed"; done; done |
  tr '"' '\001' | xargs -P "$(nproc)" -d '\n' -I{} bash -c 'set -euo pipefail; read -r -a words <<< "$(tr "\001" "\"" <<< "$1")"; one "${words[@]}"' _ {}
cat "$out"/*/result.tsv > "$out/results.tsv"
cut -f1-7 "$out/results.tsv" | column -t -s $'\t' -N concealed,seed,outcome,right,rounds,rig_s,once-more
