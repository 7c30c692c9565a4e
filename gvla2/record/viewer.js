// Shows the glTF file (GLB, no textures) inside a figure's data-glb: drag turns it, two fingers or Shift move it.
(() => {
  const VERTEX = `#version 300 es
    in vec3 position; in vec4 colour; uniform mat4 view; uniform float size; out vec3 at; out vec4 paint;
    void main() { at = position; paint = colour; gl_Position = view * vec4(position, 1.0); gl_PointSize = size; }`;
  const FRAGMENT = `#version 300 es
    precision highp float; in vec3 at; in vec4 paint; uniform float lit; uniform vec3 eye; out vec4 pixel;
    void main() {
      float light = 1.0;
      if (lit > 0.0) { // points and lines have no side
        vec3 normal = normalize(cross(dFdx(at), dFdy(at)));
        light = 0.35 + 0.4 * abs(dot(normal, normalize(eye - at))) + 0.25 * abs(normal.y);
      }
      pixel = vec4(paint.rgb * light, 1.0);
    }`;
  const COUNT = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT4: 16 };
  const ARRAY = { 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
  // Yaw, pitch and field of view, radians; the narrow lens of maps leaves lengths as they are.
  const FACES = { free: [0.9, 0.5, 0.5], top: [-Math.PI / 2, 1.5706, 0.03], side: [0, 0.02, 0.03] };

  const read = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const length = new DataView(bytes.buffer).getUint32(12, true);
    return [JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length))), bytes.buffer, 28 + length];
  };
  const values = ([file, buffer, start], index) => {
    const accessor = file.accessors[index], part = file.bufferViews[accessor.bufferView];
    const from = start + (part.byteOffset || 0) + (accessor.byteOffset || 0);
    return new ARRAY[accessor.componentType](buffer, from, accessor.count * COUNT[accessor.type]);
  };
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  const build = (figure) => {
    const canvas = figure.querySelector("canvas"), names = figure.querySelector(".names"), said = figure.querySelector("output");
    const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true }); // kept for printing
    if (!gl) { said.textContent = "This browser has no WebGL 2. The same view is the file scene.glb beside this page."; return; }
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader); gl.attachShader(program, shader);
    }
    ["position", "colour"].forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program); gl.useProgram(program); gl.enable(gl.DEPTH_TEST);
    const [view, size, lit, eyeAt] = ["view", "size", "lit", "eye"].map((name) => gl.getUniformLocation(program, name));

    // The parts: one vertex array each. Their positions stand in the world already.
    const file = read(figure.dataset.glb), parts = [], low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    const store = (data, place, width, type, normal) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, width, type, normal, 0, 0);
    };
    for (const node of file[0].nodes) for (const shape of node.mesh === undefined ? [] : file[0].meshes[node.mesh].primitives) {
      const part = { ...node.extras, mode: shape.mode ?? gl.TRIANGLES, array: gl.createVertexArray() };
      const { POSITION, COLOR_0 } = shape.attributes, box = file[0].accessors[POSITION];
      gl.bindVertexArray(part.array);
      store(values(file, POSITION), 0, 3, gl.FLOAT, false);
      if (COLOR_0 !== undefined) store(values(file, COLOR_0), 1, COUNT[file[0].accessors[COLOR_0].type], gl.UNSIGNED_BYTE, true);
      part.plain = COLOR_0 === undefined;
      part.count = box.count;
      if (shape.indices !== undefined) {
        const index = values(file, shape.indices);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.STATIC_DRAW);
        part.count = index.length; part.type = file[0].accessors[shape.indices].componentType;
      }
      if (part.label) box.min.forEach((v, k) => {
        low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], box.max[k]);
      });
      if (part.label) {
        part.name = names.appendChild(document.createElement("button"));
        part.name.type = "button"; part.name.className = part.kind + (part.bad ? " bad" : "");
        part.name.textContent = part.label;
        part.name.addEventListener("click", () => { said.textContent = part.text; });
      }
      parts.push(part);
    }
    if (low[0] > high[0]) { low.fill(-0.3); high.fill(0.3); }
    const middle = low.map((v, k) => (v + high[k]) / 2);
    const radius = Math.max(0.1, Math.hypot(...low.map((v, k) => high[k] - v)) / 2);
    const hidden = new Set(), camera = {};
    const face = (name) => {
      [camera.yaw, camera.pitch, camera.lens] = FACES[name];
      camera.target = [...middle];
      camera.away = camera.first = (radius * Math.max(1, canvas.clientHeight / canvas.clientWidth)) / Math.sin(camera.lens / 2);
      later();
    };

    // Where the camera stands, its axes, and the matrix of the shader, column by column.
    const frame = () => {
      const { yaw, pitch, away, lens, target } = camera, flat = Math.cos(pitch);
      const back = [flat * Math.sin(yaw), Math.sin(pitch), flat * Math.cos(yaw)];
      const right = [Math.cos(yaw), 0, -Math.sin(yaw)], up = cross(back, right);
      const eye = target.map((v, k) => v + away * back[k]);
      const [near, far] = [Math.max(away / 50, away - 30 * radius), away + 30 * radius];
      const f = 1 / Math.tan(lens / 2), wide = canvas.clientWidth / canvas.clientHeight, matrix = new Float32Array(16);
      const rows = [right.map((v) => (v * f) / wide), up.map((v) => v * f), back.map((v) => (v * (far + near)) / (near - far)), back.map((v) => -v)];
      rows.forEach((row, r) => {
        row.forEach((v, c) => { matrix[4 * c + r] = v; });
        matrix[12 + r] = -dot(row, eye) + (r === 2 ? (2 * far * near) / (near - far) : 0);
      });
      return { matrix, eye, right, up };
    };
    const draw = () => {
      const scale = window.devicePixelRatio || 1, [width, height] = [canvas.clientWidth, canvas.clientHeight];
      if (!width || !height) return;
      [canvas.width, canvas.height] = [Math.round(width * scale), Math.round(height * scale)];
      const { matrix, eye } = frame(), ink = getComputedStyle(figure).getPropertyValue("--lines").split(",").map((v) => v / 255);
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix4fv(view, false, matrix); gl.uniform3fv(eyeAt, eye);
      gl.uniform1f(size, Math.max(1.5, (0.0065 * canvas.height) / (2 * Math.tan(camera.lens / 2) * camera.away)));
      for (const part of parts) {
        if (hidden.has(part.kind)) continue;
        gl.bindVertexArray(part.array); gl.uniform1f(lit, part.mode === gl.TRIANGLES ? 1 : 0);
        if (part.plain) gl.vertexAttrib4f(1, ink[0], ink[1], ink[2], 1);
        if (part.type) gl.drawElements(part.mode, part.count, part.type, 0);
        else gl.drawArrays(part.mode, 0, part.count);
      }
      place(matrix, width, height);
    };
    // Numbers stand on their waypoints, names above their objects; one that would cover another moves aside or up.
    const place = (m, width, height) => {
      const taken = [];
      const spots = parts.filter((part) => part.name).map((part) => {
        const [x, y, , w] = [0, 1, 2, 3].map((r) => dot([m[r], m[4 + r], m[8 + r]], part.at) + m[12 + r]);
        return { part, w, x: (0.5 + x / w / 2) * width, y: (0.5 - y / w / 2) * height };
      });
      for (const { part, w, x, y } of spots.sort((a, b) => (b.part.kind > a.part.kind ? 1 : b.part.kind < a.part.kind ? -1 : a.w - b.w))) {
        part.name.hidden = hidden.has(part.kind) || w <= 0 || x < 0 || x > width || y < 0 || y > height;
        if (part.name.hidden) continue;
        const { offsetWidth: across, offsetHeight: tall } = part.name;
        const stop = part.kind === "waypoint", [aside, rise] = stop ? [across / 2, 0] : [0, tall / 2];
        let left = Math.min(Math.max(x - across / 2, 0), width - across), top = Math.max(0, stop ? y - tall / 2 : y - tall - 5);
        const covers = (t) => left < t.left + t.across && t.left < left + across && top < t.top + t.tall && t.top < top + tall;
        for (let tries = 0; tries < 12 && taken.some(covers); tries += 1) [left, top] = [left + aside, top - rise];
        taken.push({ left, top, across, tall });
        part.name.style.transform = `translate(${left}px, ${top}px)`;
      }
    };
    let waiting = false;
    const later = () => {
      if (!waiting) requestAnimationFrame(() => { waiting = false; draw(); });
      waiting = true;
    };

    const turn = (dx, dy) => {
      camera.yaw += dx; camera.pitch = Math.min(1.5706, Math.max(-0.2, camera.pitch + dy)); later();
    };
    const zoom = (by) => { camera.away = Math.min(8, Math.max(0.08, (camera.away * by) / camera.first)) * camera.first; later(); };
    const move = (dx, dy) => {
      const { right, up } = frame(), unit = (2 * Math.tan(camera.lens / 2) * camera.away) / canvas.clientHeight;
      camera.target = camera.target.map((v, k) => v + unit * (dy * up[k] - dx * right[k])); later();
    };
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      fingers.set(event.pointerId, now);
      if (other) {
        zoom(Math.hypot(before[0] - other[0], before[1] - other[1]) / Math.max(1, Math.hypot(now[0] - other[0], now[1] - other[1])));
        move(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons & 6) move(dx, dy);
      else turn(-dx * 0.008, dy * 0.008);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => { // a page that is being scrolled past is not held up
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault(); zoom(Math.exp(event.deltaY * 0.0015));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const [dx, dy] = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key] || [0, 0];
      const by = { "+": 0.85, "-": 1.18 }[event.key];
      if (dx || dy) turn(dx, dy); else if (by) zoom(by); else return;
      event.preventDefault();
    });
    figure.querySelectorAll("[data-face]").forEach((button) => button.addEventListener("click", () => {
      face(button.dataset.face); said.textContent = button.title;
    }));
    figure.querySelectorAll("[data-zoom-by]").forEach((button) => button.addEventListener("click", () => zoom(Number(button.dataset.zoomBy))));
    figure.querySelectorAll("[data-kinds]").forEach((box) => box.addEventListener("change", () => {
      box.dataset.kinds.split(" ").forEach((kind) => (box.checked ? hidden.delete(kind) : hidden.add(kind))); later();
    }));
    new ResizeObserver(later).observe(canvas);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", later);
    face("free");
  };
  document.querySelectorAll("figure[data-glb]").forEach((figure) => {
    try { build(figure); } catch (error) { figure.querySelector("output").textContent = `The 3D view failed: ${error.message}`; }
  });
  // A film that this browser cannot play gives way to the animation.
  document.querySelectorAll("video").forEach((film) => film.addEventListener("error", () => {
    const picture = film.nextElementSibling;
    if (picture?.hidden) { film.hidden = true; picture.hidden = false; }
  }));
})();
