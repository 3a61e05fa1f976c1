#!/bin/sh
# Makes the certificates by which the processes of a run know each other across a network.
#
#     deploy/certificates.sh FOLDER HOST...
#
# HOST is each name or IP address by which the hub's machine is reached. FOLDER gets the authority
# (ca.pem) and, for each role, hub, learner and actor, a certificate with its key, good for a year.
# Run again, it keeps the authority and makes the others anew. On another machine put ca.pem and the
# two files of its role alone; ca-key.pem, which can make more of them, should stay where it is.
set -eu

if [ $# -lt 2 ]; then
    echo "usage: $0 FOLDER HOST...   as in: $0 certificates learner.example.org 192.0.2.7" >&2
    exit 2
fi
folder=$1
shift
names=DNS:localhost,IP:127.0.0.1,IP:::1
for host; do
    case $host in
        *[!0-9.:a-fA-F]*) kind=DNS ;;
        *.*.*.* | *:*) kind=IP ;;
        *) kind=DNS ;;
    esac
    names=$names,$kind:$host
done

umask 077
mkdir -p "$folder"
cd "$folder"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if ! [ -f ca-key.pem ]; then
    openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 3650 \
        -subj "/CN=ALE-Robot authority" -keyout ca-key.pem -out ca.pem 2>"$work/said" ||
        { cat "$work/said" >&2; exit 1; }
fi
for role in hub learner actor; do
    {
        echo "basicConstraints=critical,CA:false"
        echo "keyUsage=critical,digitalSignature"
        if [ $role = hub ]; then
            echo "extendedKeyUsage=serverAuth"
            echo "subjectAltName=$names"
        else
            echo "extendedKeyUsage=clientAuth"
            echo "subjectAltName=DNS:$role"
        fi
    } >"$work/extensions"
    {
        openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$role" \
            -keyout "$work/key" -out "$work/request" &&
            openssl x509 -req -in "$work/request" -days 365 -CA ca.pem -CAkey ca-key.pem \
                -CAcreateserial -CAserial "$work/serial" -extfile "$work/extensions" -out "$work/certificate"
    } 2>"$work/said" || { cat "$work/said" >&2; exit 1; }
    mv "$work/key" "$role-key.pem"
    mv "$work/certificate" "$role.pem"
done
echo "Certificates for $names are in $folder."
