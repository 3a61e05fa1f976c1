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
# What fails leaves everything as it was.
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

usage() {
    echo "usage: $0 FOLDER HOST...   as in: $0 certificates learner.example.org 192.0.2.7"
    echo "       $0 FOLDER --actors NAME...   as in: $0 certificates --actors robot-1 robot-2"
    echo "       $0 FOLDER --runs NAME...   as in: $0 certificates --runs breakout"
}

refuse() {
    echo "error: $*" >&2
    exit 2
}

case ${2-} in
    --actors) role=actor ;;
    --runs) role=replay ;;
    *) role= ;;
esac
for word; do
    case $word in
        -h | --help) usage; exit ;;
        --actors | --runs) ;;
        -*) [ "$role" ] || { usage >&2; refuse "there is no option $word: use it as above."; } ;;
    esac
done
case ${1:--} in -*) set -- ;; esac  # no folder
if [ $# -lt 2 ] || { [ "$role" ] && [ $# -lt 3 ]; }; then
    usage >&2
    exit 2
fi
lasting=3650  # days that the authority is good for
case ${DAYS:=365} in
    0* | *[!0-9]* | ?????*) days=0 ;;
    *) days=$DAYS ;;
esac
if [ "$days" -lt 1 ] || [ "$days" -gt $lasting ]; then
    refuse "DAYS is '$DAYS': give the number of days that the certificates are good for," \
        "1 to $lasting."
fi
folder=$1
shift

names=DNS:localhost,IP:127.0.0.1,IP:::1
if [ "$role" ]; then
    list=${1#--}.txt
    most=$((63 - ${#role}))  # of 64 characters of a common name
    shift
    for name; do
        case $name in
            [!0-9A-Za-z]* | *[!0-9A-Za-z._-]* | "") wrong=yes ;;
            *) wrong= ;;
        esac
        if [ -n "$wrong" ] || [ ${#name} -gt $most ]; then
            refuse "no ${list%s.txt} can be called '$name': up to $most letters, digits, '.', '_' or '-'," \
                "a letter or digit first."
        fi
    done
else
    for host; do
        case $host in  # nothing that openssl would take as more than a name
            [!0-9A-Za-z:]* | *[!0-9A-Za-z.:_-]* | *[!0-9A-Fa-f.:]*:* | "")
                refuse "no host can be called '$host': give a name, without its port, or an IP address."
                ;;
            *:*) kind=IP ;;
            *[!0-9.]*) kind=DNS ;;
            *) kind=IP ;;
        esac
        case ,$names, in
            *,$kind:$host,*) ;;
            *) names=$names,$kind:$host ;;
        esac
    done
fi

if [ -f "$folder/ca.pem" ] && ! [ -f "$folder/ca-key.pem" ]; then  # as on the machine of an actor
    refuse "$folder has ca.pem without ca-key.pem: make certificates in the folder that has both."
fi
if [ "$role" ] && ! [ -f "$folder/ca-key.pem" ]; then
    refuse "there is no $folder/ca-key.pem: make an authority with $0 $folder HOST..."
fi
umask 077
[ -d "$folder" ] && made= || made=yes
mkdir -p "$folder"
cd "$folder"
leave() {
    rm -rf "$work"
    if [ "$made" ]; then rmdir "$PWD"; fi
}
work=
trap leave EXIT
trap 'exit 1' HUP INT TERM
work=$(mktemp -d "$PWD/.making.XXXXXX")  # on the same disk, so that a full one refuses nothing at the end
mkdir "$work/made"

quietly() {  # what it says is shown only where it fails
    "$@" >"$work/said" 2>&1 || {
        echo "error: $1 failed ($(tail -n 1 "$work/said")): fix that, and start again." >&2
        exit 1
    }
}

certify() {  # common name, purpose, names in the certificate
    {
        echo "basicConstraints=critical,CA:false"
        echo "keyUsage=critical,digitalSignature"
        echo "extendedKeyUsage=$2"
        echo "subjectAltName=$3"
    } >"$work/extensions"
    quietly openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$1" \
        -keyout "$work/made/$1-key.pem" -out "$work/request"
    quietly openssl x509 -req -in "$work/request" -days "$DAYS" -CA "$authority/ca.pem" \
        -CAkey "$authority/ca-key.pem" -CAcreateserial -CAserial "$work/serial" \
        -extfile "$work/extensions" -out "$work/made/$1.pem"
}

authority=.
if [ "$role" ]; then
    for name; do
        certify "$role.$name" clientAuth "DNS:$role"
    done
    mv -f "$work/made"/* .
    if [ -n "$(tail -c 1 "$list" 2>/dev/null)" ]; then
        echo >>"$list"  # an editor left the last line without an end
    fi
    for name; do
        grep -qxF -- "$name" "$list" 2>/dev/null || echo "$name" >>"$list"
    done
    echo "Names in $folder/$list: $(wc -l <"$list"). A hub reads the file when it starts."
    exit
fi

if ! [ -f ca-key.pem ]; then
    authority=$work/made
    quietly openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days $lasting \
        -subj "/CN=ALE-Robot authority" -keyout "$authority/ca-key.pem" -out "$authority/ca.pem"
fi
certify hub serverAuth "$names"
certify learner clientAuth DNS:learner
certify actor clientAuth DNS:actor
mv -f "$work/made"/* .
made=
echo "Certificates for $names are in $folder."
