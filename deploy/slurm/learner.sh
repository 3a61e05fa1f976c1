
# The lines above are the run's own. This job hosts replay, hub and learner, and has the actors
# submitted. Slurm may take it away, by preemption or requeue, at any time: it goes on where it was.
set -u
export PYTHONSAFEPATH=1
host=$(hostname -f)
address=$scheme/$host:$((20000 + SLURM_JOB_ID % 10000))
secure=()
if [ "$scheme" = tls ]; then
    # The authority stays; the hub's certificate is of the node that the job has now.
    sh "$run/slurm/certificates.sh" "$run/certificates" "$host" || exit 1
    secure=(--certificates "$run/certificates")
fi
if [ -d "$run/replay" ]; then flags=("${resume[@]}"); else flags=("${begin[@]}"); fi

"$python" -m learner "${flags[@]}" --listen "$scheme/0.0.0.0:${address##*:}" "${secure[@]}" &
learner=$!
stopped='' again=''
trap 'stopped=1; kill -TERM $learner' TERM            # preempted, requeued or cancelled
trap 'stopped=1; again=1; kill -TERM $learner' USR1   # the time limit is near

echo "$address" >"$run/address.new" && mv "$run/address.new" "$run/address"
if [ -z "$(squeue --noheader --me --name "$SLURM_JOB_NAME-actors")" ]; then
    sbatch "$run/slurm/actors.sh" || echo "submit the actors by hand: sbatch $run/slurm/actors.sh"
fi

while kill -0 $learner 2>/dev/null; do wait $learner; done
wait $learner
status=$?
if [ "$again" ]; then
    scontrol requeue "$SLURM_JOB_ID"
elif [ -z "$stopped" ]; then # the run is over, or refuses to go on
    rm -f "$run/address"
    scancel --quiet --me --name "$SLURM_JOB_NAME-actors"
fi
exit $status
