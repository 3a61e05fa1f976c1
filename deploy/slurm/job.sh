
# The lines above are the run's own. Each job is one process of the run: its hub (the learner, or a
# replay of its own), a learner that joins a replay, or one of the actors, an array whose last tasks are
# evaluators. Slurm may take a job away at any time, by preemption or requeue: it goes on where it was.
# The others find the hub by the file `address`; without it the run is over.
set -u
export PYTHONSAFEPATH=1
secure=() role=()
[ "$scheme" = tls ] && secure=(--certificates "$run/certificates")
if [ "$module" = "$hub" ]; then
    host=$(hostname -f)
    if [ "$scheme" = tls ]; then
        # The authority and the actors' stay; the hub's certificate is of the node that it has now.
        sh "$run/slurm/certificates.sh" "$run/certificates" "$host" || exit 1
    fi
    port=$("$python" -m deploy.hub_port "$SLURM_JOB_ID") || exit 1
    echo "$scheme/$host:$port" >"$run/address.new"
    mv "$run/address.new" "$run/address"
    for n in "${!others[@]}"; do
        # A second one would end the run: where Slurm does not say that there is none, it is not submitted.
        for _ in 1 2 3; do
            queued=$(squeue --noheader --me --name "${jobs[n]}") && break
            queued=unknown
            sleep 5
        done
        script=$run/slurm/${others[n]}.sh
        if [ "$queued" = unknown ] || { [ -z "$queued" ] && ! sbatch "$script"; }; then
            echo "unless it is in the queue, submit the ${others[n]} by hand: sbatch $script"
        fi
    done
elif [ "$module" = actors ]; then
    role=(--name "actor-$SLURM_ARRAY_TASK_ID")
    if [ "$SLURM_ARRAY_TASK_ID" -gt "$actors" ]; then
        role=(--name "evaluator-$SLURM_ARRAY_TASK_ID" --evaluator)
    fi
fi

touch "$run/slurm/$module.began"
process='' stopped='' again='' status=0
trap 'stopped=1; kill -TERM $process' TERM            # preempted, requeued or cancelled
trap 'stopped=1; again=1; kill -TERM $process' USR1   # the time limit is near
while [ -z "$stopped" ] && address=$(cat "$run/address" 2>/dev/null); do
    place=(--connect "$address")
    [ "$module" = "$hub" ] && place=(--listen "$scheme/0.0.0.0:${address##*:}")
    if [ -e "$run/$begun" ]; then flags=("${resume[@]}"); else flags=("${begin[@]}"); fi
    "$python" -m "$module" "${place[@]}" "${flags[@]}" "${role[@]}" "${secure[@]}" &
    process=$! moved=''
    while kill -0 $process 2>/dev/null; do
        sleep 5 & wait -n
        if [ -z "$moved" ] && [ "$address" != "$(cat "$run/address" 2>/dev/null)" ]; then
            moved=1
            kill -TERM $process
        fi
    done
    wait $process
    status=$?
    [ "$moved" ] && continue
    [ "$module" = actors ] || break
    case " ${final[*]} " in *" $status "*) break ;; esac
    [ "$stopped" ] || { echo "ended by status $status: it starts again in 5 s"; sleep 5 & wait $!; }
done

# One that was killed, but got on since it began, goes on; its own restarts are of its work alone.
[ "$module" != actors ] && [ -z "$stopped" ] && [ $status -gt 128 ] &&
    [ "$run/$kept" -nt "$run/slurm/$module.began" ] && again=1
if [ "$again" ]; then
    scontrol requeue "$SLURM_JOB_ID"
elif [ -z "$stopped" ] && [ "$module" != actors ]; then # the run is over, or refuses to go on
    rm -f "$run/address"
    for job in "${jobs[@]}"; do scancel --quiet --me --name "$job"; done
fi
exit $status
