#!/usr/bin/env bash
# boot.sh ROOT GROUP: runs the systemd of a Debian system as the first process of namespaces of its own, in a control group.
set -euo pipefail

echo $$ > "$2/cgroup.procs"
exec unshare --mount --pid --fork --uts --ipc --net --cgroup --kill-child --propagation private -- bash -euc '
root=$1
mount --bind "$root" "$root"
mount -t proc proc "$root/proc"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t tmpfs -o mode=755 tmpfs "$root/run"
mount -t tmpfs -o mode=1777 tmpfs "$root/tmp"
mount -t tmpfs -o mode=755 tmpfs "$root/dev"
for name in null zero full random urandom tty; do
    touch "$root/dev/$name"
    mount --bind "/dev/$name" "$root/dev/$name"
done
mkdir "$root/dev/pts" "$root/dev/shm"
mount --bind /dev/pts "$root/dev/pts"
ln -s /proc/self/fd "$root/dev/fd"
mknod -m 666 "$root/dev/ptmx" c 5 2
ip link set lo up || true
cd "$root"
mkdir -p .outside
pivot_root . .outside # a mere chroot may not have namespaces of users (PrivateUsers=)
umount --lazy /.outside
rmdir /.outside
mount --make-rshared / # as at the boot of a machine: credentials are mounted by a process of its own
exec env -i container=starter-gateway-test PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd --log-target=journal
' bash "$1"
