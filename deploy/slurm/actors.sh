
# The lines above are the run's own. Each task of this array is an actor, the last are evaluators.
# They find the learner by the file `address`, which it writes anew wherever it is started.
set -u
export PYTHONSAFEPATH=1
role=(--name "actor-$SLURM_ARRAY_TASK_ID")
if [ "$SLURM_ARRAY_TASK_ID" -gt "$actors" ]; then
    role=(--name "evaluator-$SLURM_ARRAY_TASK_ID" --evaluator)
fi
secure=()
[ "$scheme" = tls ] && secure=(--certificates "$run/certificates")
stopped='' again='' status=0
trap 'stopped=1; kill -TERM $actor' TERM
trap 'stopped=1; again=1; kill -TERM $actor' USR1

# Without the file the run is over.
while [ -z "$stopped" ] && address=$(cat "$run/address" 2>/dev/null); do
    "$python" -m actors --connect "$address" "${flags[@]}" "${role[@]}" "${secure[@]}" &
    actor=$!
    moved=''
    while kill -0 $actor 2>/dev/null; do
        sleep 5 & wait -n
        if [ "$address" != "$(cat "$run/address" 2>/dev/null)" ]; then
            moved=1
            kill -TERM $actor
        fi
    done
    wait $actor
    status=$?
    [ "$moved" ] || break
done
[ "$again" ] && scontrol requeue "$SLURM_JOB_ID"
exit $status
