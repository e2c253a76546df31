#!/bin/bash
# The paper's campaign on the simulated rig: every specimen of its table through the daemon in virtual time, with
# strain stiffening and mesh friction switched on (effects-*.toml), exported, analysed, reported.
#
#   proof/campaign/run.sh OUT              12 actuators x 4 pressures x 5 repetitions: 270 h of rig time, about 10 minutes
#   proof/campaign/run.sh --short OUT      12 actuators x 4 pressures x 2 repetitions, faster returns: about a minute
#   proof/campaign/run.sh --reduced OUT    the same with 3 actuators: a quarter of that
#   --jobs N   runs at a time (default: one per processor);  --keep   also the runs themselves (0.4 GB each)
#
# OUT/campaign-report.html is the report, OUT/recordings/ what it was made from. ISORIG names the program (build/bin/isorig).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
isorig=${ISORIG:-$root/build/bin/isorig}
protocol=$root/config/protocols/vma-isovelocity.toml
specimens=(control1 control2 control3 urethane1 urethane2 urethane3 ecoflex1 ecoflex2 ecoflex3 carbopol1 carbopol2 carbopol3)
jobs=$(nproc)
keep=no
out=
while (($#)); do
  case $1 in
    --short) protocol=$here/reduced.toml ;;
    --reduced) protocol=$here/reduced.toml specimens=(control1 urethane1 ecoflex1) ;;
    --jobs) jobs=$2; shift ;;
    --keep) keep=yes ;;
    -*) echo "run.sh: unknown option $1" >&2; exit 2 ;;
    *) out=$1 ;;
  esac
  shift
done
[[ -n $out ]] || { echo "usage: run.sh [--short | --reduced] [--jobs N] [--keep] OUT" >&2; exit 2; }
mkdir -p "$out/rigs" "$out/recordings" "$out/runs"
out=$(cd "$out" && pwd)

# One specimen: a rig of its own (specimen, effects, seed), its run, its recordings.
one() {
  local name=$1 seed=$2 rig=$out/rigs/$1.toml
  sed "s#^specimen = .*#specimen = \"$root/config/specimens/$name.toml\"#" "$root/config/rigs/sim.toml" > "$rig"
  printf '\n[sim.physics]\neffects = "%s/effects-%s.toml"\nnominal_pressure_psi = 15.0\n' "$here" "${name: -1}" >> "$rig"
  rm -rf "${out:?}/recordings/$name" "$out/runs/$name"
  # A fault or missing samples end the campaign: it reports nothing that was not measured.
  "$isorig" run "$protocol" --rig "$rig" --runs "$out/runs/$name" --seed "$seed" --quiet > "$out/runs/$name.txt" ||
    { cat "$out/runs/$name.txt" >&2; return 1; }
  local run
  run=$(find "$out/runs/$name" -mindepth 1 -maxdepth 1 -type d)
  "$isorig" export "$run" --out "$out/recordings/$name" > "$out/runs/$name-export.txt"
  [[ $keep == yes ]] || rm -rf "$out/runs/$name"
  head -2 "$out/runs/$name.txt"
}
export -f one
export isorig protocol out root here keep

seed=1
for name in "${specimens[@]}"; do
  printf '%s %s\n' "$name" $((seed++))
done | xargs -P "$jobs" -L 1 bash -c 'set -euo pipefail; one "$@"' _

"$isorig" campaign "$out"/recordings/*/* --out "$out" --simulated \
  "Everything here is simulated. Actuators: the paper's lengths and meshes, with standard linear solids whose numbers were \
chosen after the paper's text (docs/simulated-rig.md), plus strain stiffening and mesh friction of chosen size, which the fitted model \
does not have (proof/campaign/effects-*.toml). Frame, pressure side and their noise: the simulated rig, driven by the real \
daemon in virtual time. Repetitions differ by noise and history only, so the SDs are those of the instruments, not of \
specimens. Trends that were put in by choosing parameters come out again and prove the analysis, not the material."
