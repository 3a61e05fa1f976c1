#!/bin/sh
# Makes the certificates by which the processes of a run know each other across a network.
#
#     deploy/certificates.sh FOLDER HOST...
#     deploy/certificates.sh FOLDER --actors NAME...
#     deploy/certificates.sh FOLDER --runs NAME...
#
# The first makes an authority (ca.pem) and, for each role, hub, learner and actor, a certificate with
# its key, good for a year, or for $DAYS days. HOST is each name or IP address by which the hub's
# machine is reached. Run again, it keeps the authority and makes the others anew.
#
# The second makes a certificate for each actor or evaluator alone, actor.NAME.pem, and adds the name
# to actors.txt. A hub whose folder has that list lets in these actors only, and none of them in
# another's name; a name that is deleted from it is out when the hub is started again.
#
# The third makes a certificate for the replay of each run that joins the hub of another run,
# replay.NAME.pem, and adds the run to runs.txt. Replays of other runs are not let in.
#
# On another machine put ca.pem and the two files of its process alone, and on that of a learner that is
# the hub both roles' files; ca-key.pem, which can make more of them, should stay where it is.
set -eu

case ${2-} in
    --actors) role=actor ;;
    --runs) role=replay ;;
    *) role= ;;
esac
if [ $# -lt 2 ] || { [ "$role" ] && [ $# -lt 3 ]; }; then
    echo "usage: $0 FOLDER HOST...   as in: $0 certificates learner.example.org 192.0.2.7" >&2
    echo "       $0 FOLDER --actors NAME...   as in: $0 certificates --actors robot-1 robot-2" >&2
    echo "       $0 FOLDER --runs NAME...   as in: $0 certificates --runs breakout" >&2
    exit 2
fi
case ${DAYS:=365} in
    0* | *[!0-9]*)
        echo "error: DAYS is '$DAYS': give the number of days that the certificates are good for, from 1." >&2
        exit 2
        ;;
esac
folder=$1
shift

umask 077
mkdir -p "$folder"
cd "$folder"
if [ -f ca.pem ] && ! [ -f ca-key.pem ]; then  # as on the machine of an actor
    echo "error: $folder has ca.pem without ca-key.pem: make certificates in the folder that has both." >&2
    exit 2
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

quietly() {  # what it says is shown only where it fails
    "$@" >"$work/said" 2>&1 || { cat "$work/said" >&2; exit 1; }
}

certify() {  # common name, purpose, names in the certificate
    {
        echo "basicConstraints=critical,CA:false"
        echo "keyUsage=critical,digitalSignature"
        echo "extendedKeyUsage=$2"
        echo "subjectAltName=$3"
    } >"$work/extensions"
    quietly openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$1" \
        -keyout "$work/key" -out "$work/request"
    quietly openssl x509 -req -in "$work/request" -days "$DAYS" -CA ca.pem -CAkey ca-key.pem \
        -CAcreateserial -CAserial "$work/serial" -extfile "$work/extensions" -out "$work/certificate"
    mv "$work/key" "$1-key.pem"
    mv "$work/certificate" "$1.pem"
}

if [ "$role" ]; then
    list=${1#--}.txt
    most=$((63 - ${#role}))  # of 64 characters of a common name
    shift
    if ! [ -f ca-key.pem ]; then
        echo "error: there is no $folder/ca-key.pem: make an authority with $0 $folder HOST..." >&2
        exit 2
    fi
    for name; do
        case $name in
            [!0-9A-Za-z]* | *[!0-9A-Za-z._-]* | "") wrong=yes ;;
            *) wrong= ;;
        esac
        if [ -n "$wrong" ] || [ ${#name} -gt $most ]; then
            echo "error: no ${list%s.txt} can be called '$name': up to $most letters, digits, '.', '_' or '-'," \
                "a letter or digit first." >&2
            exit 2
        fi
    done
    if [ -n "$(tail -c 1 "$list" 2>/dev/null)" ]; then
        echo >>"$list"  # an editor left the last line without an end
    fi
    for name; do
        certify "$role.$name" clientAuth "DNS:$role"
        grep -qxF -- "$name" "$list" 2>/dev/null || echo "$name" >>"$list"
    done
    echo "Names in $folder/$list: $(wc -l <"$list"). A hub reads the file when it starts."
    exit
fi

names=DNS:localhost,IP:127.0.0.1,IP:::1
for host; do
    case $host in
        *[!0-9.:a-fA-F]*) kind=DNS ;;
        *.*.*.* | *:*) kind=IP ;;
        *) kind=DNS ;;
    esac
    case ,$names, in
        *,$kind:$host,*) ;;
        *) names=$names,$kind:$host ;;
    esac
done
if ! [ -f ca-key.pem ]; then
    quietly openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 3650 \
        -subj "/CN=ALE-Robot authority" -keyout ca-key.pem -out ca.pem
fi
certify hub serverAuth "$names"
certify learner clientAuth DNS:learner
certify actor clientAuth DNS:actor
echo "Certificates for $names are in $folder."
