// Decodes poses, and places instances and marks at an instant. The formats are those of encoding.py, marks.py and replay.py.
const THREE = MeshCat.THREE;
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));

function bytesOf(text) {
    const bits = atob(text), bytes = new Uint8Array(bits.length);
    for (let k = 0; k < bits.length; k++) bytes[k] = bits.charCodeAt(k);
    return bytes;
}

async function inflated(text) {
    const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).arrayBuffer();
}

// poses of all columns at an instant: linear between frames, and between keys where an impact bent the path
class Poses {
    static async decoded() {
        const poses = new Poses(), frames = DATA.frames, size = 7 * DATA.columns;
        const first = new Uint16Array(await inflated(DATA.first));
        const varying = new Uint8Array(await inflated(DATA.varying));
        const halves = new Uint8Array(await inflated(DATA.differences)), half = halves.length / 2;
        const where = [];
        for (let k = 0; k < size; k++) if (varying[k]) where.push(k);
        const count = where.length, values = new Uint16Array(frames * count), change = new Uint16Array(count);
        for (let k = 0; k < count; k++) values[k] = first[where[k]];
        for (let f = 1, j = 0; f < frames; f++) for (let k = 0, here = f * count; k < count; k++, j++) {
            change[k] += halves[j] | (halves[half + j] << 8);
            values[here + k] = values[here - count + k] + change[k];
        }
        Object.assign(poses, { count, values, signed: new Int16Array(values.buffer), where: Int32Array.from(where) });
        poses.position = new Float64Array(3 * DATA.columns);
        poses.turn = new Float64Array(4 * DATA.columns);
        const turns = new Int16Array(first.buffer);
        for (let c = 0; c < DATA.columns; c++) {
            for (let k = 0; k < 3; k++) poses.position[3 * c + k] = DATA.origin[k] + DATA.step * first[7 * c + k];
            for (let k = 0; k < 4; k++) poses.turn[4 * c + k] = DATA.turnStep * turns[7 * c + 3 + k];
        }
        poses.keyTimes = new Float64Array(await inflated(DATA.keyTimes));
        poses.keyColumns = new Int32Array(await inflated(DATA.keyColumns));
        poses.keys = new Uint16Array(await inflated(DATA.keys));
        poses.keyTurns = new Int16Array(poses.keys.buffer);
        poses.interval = (DATA.end - DATA.start) / Math.max(DATA.frames - 1, 1);
        return poses;
    }

    // number of the frame before an instant, and how far the instant is from there to the next
    frame(time) {
        const x = this.interval > 0 ? time / this.interval : 0;
        const f = Math.max(0, Math.min(Math.floor(x), DATA.frames - 2));
        return [f, Math.max(0, Math.min(x - f, 1))];
    }

    entry(f, k) {
        const j = this.where[k] % 7;
        return j < 3 ? DATA.origin[j] + DATA.step * this.values[f * this.count + k]
            : DATA.turnStep * this.signed[f * this.count + k];
    }

    put(k, value) {
        const column = Math.floor(k / 7), j = k % 7;
        if (j < 3) this.position[3 * column + j] = value; else this.turn[4 * column + j - 3] = value;
    }

    set(time) {
        const [f, part] = this.frame(time), count = this.count, a = f * count, b = a + count;
        const { values, signed, where } = this, step = DATA.step, turnStep = DATA.turnStep;
        for (let k = 0; k < count; k++) {
            const at = where[k], column = (at / 7) | 0, j = at - 7 * column;
            if (j < 3) this.position[3 * column + j] = DATA.origin[j] + step * (values[a + k] * (1 - part) + values[b + k] * part);
            else this.turn[4 * column + j - 3] = turnStep * (signed[a + k] * (1 - part) + signed[b + k] * part);
        }
        this.bend(time, f);
    }

    // replaces the straight lines of those columns that have keys between two frames
    bend(time, f) {
        const begin = f * this.interval, end = begin + this.interval, before = new Map(), after = new Map();
        for (let k = firstAbove(this.keyTimes, begin); k < this.keyTimes.length && this.keyTimes[k] < end; k++)
            if (this.keyTimes[k] <= time) before.set(this.keyColumns[k], k);
            else if (!after.has(this.keyColumns[k])) after.set(this.keyColumns[k], k);
        for (const column of new Set([...before.keys(), ...after.keys()])) {
            const left = before.get(column), right = after.get(column);
            const t0 = left === undefined ? begin : this.keyTimes[left], t1 = right === undefined ? end : this.keyTimes[right];
            const part = t1 > t0 ? (time - t0) / (t1 - t0) : 0;
            const p = this.pose(f, left, column), q = this.pose(f + 1, right, column);
            for (let j = 0; j < 7; j++) this.put(7 * column + j, p[j] * (1 - part) + q[j] * part);
        }
    }

    // the pose of a column at a key, or at a frame
    pose(f, key, column) {
        if (key === undefined) return this.atFrame(f, column);
        return Array.from({ length: 7 }, (_, j) => j < 3 ? DATA.origin[j] + DATA.step * this.keys[7 * key + j]
            : DATA.turnStep * this.keyTurns[7 * key + j]);
    }

    atFrame(f, column) {
        const found = [...this.position.slice(3 * column, 3 * column + 3), ...this.turn.slice(4 * column, 4 * column + 4)];
        for (let k = firstAbove(this.where, 7 * column - 1); k < this.count && this.where[k] < 7 * column + 7; k++)
            found[this.where[k] - 7 * column] = this.entry(f, k);
        return found;
    }

    speed(f, column) {
        if (DATA.frames < 2 || !(this.interval > 0)) return 0;
        const p = this.atFrame(f, column), q = this.atFrame(f + 1, column);
        return Math.hypot(q[0] - p[0], q[1] - p[1], q[2] - p[2]) / this.interval;
    }
}

// number of the first of some ordered values that is above a bound
function firstAbove(values, bound) {
    let low = 0, high = values.length;
    while (low < high) { const k = (low + high) >> 1; if (values[k] > bound) high = k; else low = k + 1; }
    return low;
}

const MAP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function mapped(part, out) {
    const x = Math.max(0, Math.min(part, 1)) * (MAP.length - 1), k = Math.min(Math.floor(x), MAP.length - 2), u = x - k;
    for (let j = 0; j < 3; j++) out[j] = (MAP[k][j] * (1 - u) + MAP[k + 1][j] * u) / 255;
}

function instanced(path, count) {
    const plain = viewer.scene_tree.find(path).object;
    const mesh = new THREE.InstancedMesh(plain.geometry, plain.material, Math.max(count, 1));
    mesh.instanceColor = new THREE.InstancedBufferAttribute(new Float32Array(3 * Math.max(count, 1)).fill(1), 3);
    mesh.count = count;
    mesh.frustumCulled = false;
    viewer.set_object(path.slice(0, -1), mesh);
    return mesh;
}

// the shapes that share a mesh
class Group {
    static async decoded(number) {
        const group = new Group(), data = DATA.groups[number];
        group.columns = new Int32Array(await inflated(data.columns));
        group.kinds = new Uint8Array(await inflated(data.kinds));
        group.rows = new Float32Array(await inflated(data.rows));
        group.striped = data.striped;
        group.connections = data.connections;
        group.mesh = instanced(["meshcat", "instances", String(number), "<object>"], group.columns.length);
        group.mesh.castShadow = group.mesh.receiveShadow = !data.connections;
        group.colored = group.mesh.material.vertexColors;
        return group;
    }

    // keeps the instances of the chosen shapes
    choose(kind) {
        this.shown = Array.from(this.columns.keys()).filter(k => this.kinds[k] & kind && (replay.connections || !this.connections));
        this.mesh.count = this.shown.length;
        this.mesh.visible = this.shown.length > 0;
    }

    place(poses) {
        const out = this.mesh.instanceMatrix.array, { position, turn } = poses, rows = this.rows;
        this.shown.forEach((k, n) => {
            const c = this.columns[k], r = 15 * k + 3, o = 16 * n;
            let xx = 1, xy = 0, xz = 0, yx = 0, yy = 1, yz = 0, zx = 0, zy = 0, zz = 1, px = 0, py = 0, pz = 0;
            if (c >= 0) {
                let x = turn[4 * c], y = turn[4 * c + 1], z = turn[4 * c + 2], w = turn[4 * c + 3];
                const s = 2 / (x * x + y * y + z * z + w * w);
                xx = 1 - s * (y * y + z * z); xy = s * (x * y - w * z); xz = s * (x * z + w * y);
                yx = s * (x * y + w * z); yy = 1 - s * (x * x + z * z); yz = s * (y * z - w * x);
                zx = s * (x * z - w * y); zy = s * (y * z + w * x); zz = 1 - s * (x * x + y * y);
                px = position[3 * c]; py = position[3 * c + 1]; pz = position[3 * c + 2];
            }
            for (let j = 0; j < 3; j++) {
                const a = rows[r + j], b = rows[r + 3 + j], d = rows[r + 6 + j];
                out[o + 4 * j] = xx * a + xy * b + xz * d;
                out[o + 4 * j + 1] = yx * a + yy * b + yz * d;
                out[o + 4 * j + 2] = zx * a + zy * b + zz * d;
            }
            const a = rows[r + 9], b = rows[r + 10], d = rows[r + 11];
            out[o + 12] = px + xx * a + xy * b + xz * d;
            out[o + 13] = py + yx * a + yy * b + yz * d;
            out[o + 14] = pz + zx * a + zy * b + zz * d;
            out[o + 15] = 1;
        });
        this.mesh.instanceMatrix.needsUpdate = true;
    }

    // colors of columns, three numbers each, or null for the shapes' own
    paint(colors) {
        const out = this.mesh.instanceColor.array, own = this.colored && (colors === null || this.striped);
        if (this.mesh.material.vertexColors !== own) {
            this.mesh.material.vertexColors = own;
            this.mesh.material.needsUpdate = true;
        }
        this.shown.forEach((k, n) => {
            const c = this.columns[k], fixed = colors === null || c < DATA.driven || this.connections;
            for (let j = 0; j < 3; j++) out[3 * n + j] = fixed ? this.rows[15 * k + j] : colors[3 * c + j];
        });
        this.mesh.instanceColor.needsUpdate = true;
    }
}

// percussions, cones and normals; those of impacts are seen for a while [s of the replay], and get thin
const LASTS = 0.3, WHOLE = 0.08, ARROW = 0, CONE = 1, NORMAL = 2, WIDE = 14;
const REGIMES = [[0.847, 0.106, 0.29], [0.082, 0.396, 0.753], [0.25, 0.3, 0.35]];
class Marks {
    static async decoded() {
        const marks = new Marks(), rows = marks.rows = new Float32Array(await inflated(DATA.marks));
        marks.begins = Float32Array.from({ length: rows.length / WIDE }, (_, k) => rows[WIDE * k]);
        // marks of many contacts hide the bodies; cones are those of one body
        marks.shown = [!DATA.crowded, true, false];
        marks.body = -1;
        const counts = [0, 0, 0];
        for (let k = 0; k < marks.begins.length; k++) counts[rows[WIDE * k + 2]]++;
        marks.meshes = counts.map((count, kind) => instanced(["meshcat", "marks", String(kind), "<object>"], count));
        // the longest time of a contact, which bounds the search
        marks.longest = 0;
        for (let k = 0; k < marks.begins.length; k++)
            if (isFinite(rows[WIDE * k + 1])) marks.longest = Math.max(marks.longest, rows[WIDE * k + 1] - rows[WIDE * k]);
        const up = new THREE.Vector3(0, 0, 1);
        marks.tools = [up, new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3(), new THREE.Quaternion(), new THREE.Matrix4()];
        return marks;
    }

    set(time, rate) {
        const now = DATA.start + time, { rows, tools: [up, place, along, size, turn, matrix] } = this;
        const used = [0, 0, 0], late = 1e-6 * (DATA.end - DATA.start), seen = Math.max(LASTS * rate, this.longest);
        for (let k = firstAbove(this.begins, now - seen - late); k < this.begins.length && this.begins[k] <= now + late; k++) {
            const r = WIDE * k, kind = rows[r + 2], impact = rows[r + 1] === rows[r], age = (now - rows[r]) / rate;
            if (!this.shown[kind] || (impact ? age >= LASTS : now >= rows[r + 1] - late)) continue;
            if (kind === CONE && (this.body < 0 || (rows[r + 12] !== this.body && rows[r + 13] !== this.body))) continue;
            const thick = impact && kind === ARROW ? Math.min(1, (LASTS - age) / (LASTS - WHOLE)) : 1;
            const mesh = this.meshes[kind], n = used[kind]++, wide = rows[r + 10] * thick;
            turn.setFromUnitVectors(up, along.set(rows[r + 7], rows[r + 8], rows[r + 9]));
            matrix.compose(place.set(rows[r + 4], rows[r + 5], rows[r + 6]), turn, size.set(wide, wide, rows[r + 11]));
            mesh.setMatrixAt(n, matrix);
            mesh.instanceColor.array.set(REGIMES[rows[r + 3]], 3 * n);
        }
        this.meshes.forEach((mesh, kind) => {
            mesh.count = used[kind];
            mesh.visible = used[kind] > 0;
            mesh.instanceMatrix.needsUpdate = mesh.instanceColor.needsUpdate = true;
        });
    }
}

// the colors of all columns at an instant
class Painter {
    static async decoded() {
        const painter = new Painter(), rows = new Float64Array(await inflated(DATA.strikes));
        const count = rows.length / 3;
        painter.times = Float64Array.from({ length: count }, (_, k) => rows[3 * k] - DATA.start);
        Object.assign(painter, { rows, mode: "own", colors: new Float32Array(3 * DATA.columns) });
        return painter;
    }

    paint(time, rate, poses, groups) {
        const { colors, mode } = this, [f] = poses.frame(time), one = [0, 0, 0];
        const struck = mode === "percussion" ? this.struck(time, rate) : null;
        for (let c = DATA.driven; c < DATA.columns && mode !== "own"; c++) {
            if (mode === "body") new THREE.Color().setHSL((0.6180339887 * c) % 1, 0.6, 0.58).toArray(one);
            else mapped(mode === "speed" ? poses.speed(f, c) / (DATA.fast || 1) : struck[c], one);
            colors.set(one, 3 * c);
        }
        for (const group of groups) group.paint(mode === "own" ? null : colors);
    }

    // percussions of the last moments, which fade
    struck(time, rate) {
        const found = new Float32Array(DATA.columns);
        for (let k = firstAbove(this.times, time - LASTS * rate); k < this.times.length && this.times[k] <= time; k++) {
            const column = this.rows[3 * k + 1], fades = 1 - (time - this.times[k]) / (LASTS * rate);
            found[column] = Math.max(found[column], fades * Math.sqrt(this.rows[3 * k + 2] / (DATA.strong || 1)));
        }
        return found;
    }
}

