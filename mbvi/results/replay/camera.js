// Where the camera stands, what it follows, and trails. Its own frame has y up and the scene shrunk to half diagonal 1.
const FIELD = 40, CENTRE = DATA.lower.map((low, k) => 0.5 * (low + DATA.upper[k]));
// direction from the scene to the camera, and what is upwards in the picture
const VIEWS = { fit: [0.5, -0.8, 0.33], front: [0, -1, 0.08], side: [1, 0, 0.08], top: [0, -0.001, 1] };

function local(point) {
    const [x, y, z] = point.map((value, k) => (value - CENTRE[k]) / DATA.radius);
    return new THREE.Vector3(x, z, -y);
}

const Camera = {
    followed: -1,

    // stands so far away that the whole scene is in the window
    view(name) {
        const towards = VIEWS[name], long = Math.hypot(...towards), back = new THREE.Vector3(towards[0], towards[2], -towards[1]).divideScalar(long);
        const right = new THREE.Vector3(0, 1, 0).cross(back).normalize(), up = back.clone().cross(right);
        const slope = Math.tan(FIELD * Math.PI / 360), aspect = innerWidth / innerHeight, clear = 1 - ($("bar").hidden ? 0 : $("bar").offsetHeight + 10) / innerHeight;
        let distance = 0.1;
        for (let k = 0; k < 8; k++) {
            const corner = local([0, 1, 2].map(j => (k >> j) & 1 ? DATA.upper[j] : DATA.lower[j]));
            const wide = Math.abs(corner.dot(right)) / (aspect * slope), high = Math.abs(corner.dot(up)) / (clear * slope);
            distance = Math.max(distance, corner.dot(back) + Math.max(wide, high));
        }
        const middle = this.followed < 0 ? new THREE.Vector3() : this.place();
        viewer.controls.target.copy(middle);
        viewer.camera.position.copy(back.multiplyScalar(1.12 * distance).add(middle));
        viewer.camera.fov = FIELD;
        this.lift();
    },

    // keeps the middle of the picture above the bar
    lift() {
        const high = $("bar").hidden ? 0 : $("bar").offsetHeight + 10;
        viewer.camera.setViewOffset(innerWidth, innerHeight, 0, high / 2, innerWidth, innerHeight);
        viewer.set_dirty();
    },

    place() {
        return local(Array.from(replay.poses.position.slice(3 * this.followed, 3 * this.followed + 3)));
    },

    follow(column) {
        this.followed = column;
        if (column >= 0) this.last = viewer.controls.target.clone();
        this.move();
    },

    move() {
        if (this.followed < 0) return;
        const place = this.place(), step = place.clone().sub(this.last);
        viewer.camera.position.add(step);
        viewer.controls.target.add(step);
        this.last = place;
    },
};

// the paths of chosen bodies until now
const Trails = {
    lines: new Map(),

    toggle(column) {
        const path = ["meshcat", "trails", String(column)];
        if (this.lines.delete(column)) return viewer.delete_path(path);
        const points = new Float32Array(3 * (DATA.frames + 1));
        for (let f = 0; f < DATA.frames; f++) points.set(replay.poses.atFrame(f, column).slice(0, 3), 3 * f);
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
        const color = new THREE.Color().setHSL((0.6180339887 * column) % 1, 0.9, 0.38);
        const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color }));
        line.frustumCulled = false;
        viewer.set_object(path, line);
        this.lines.set(column, { line, points: points.slice() });
        this.set(replay.time);
    },

    // ends at where the body is between two frames
    set(time) {
        const [f] = replay.poses.frame(time);
        for (const [column, { line, points }] of this.lines) {
            const attribute = line.geometry.attributes.position;
            attribute.array.set(points);
            attribute.array.set(replay.poses.position.slice(3 * column, 3 * column + 3), 3 * (f + 1));
            attribute.needsUpdate = true;
            line.geometry.setDrawRange(0, f + 2);
        }
    },
};

