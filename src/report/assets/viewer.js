'use strict';
// The 3D view of the report. Data come from the page itself: a JSON description and arrays in
// base64. All points are one object of the graphics card; what is shown is a byte per point, so
// that a million of them can be switched at once.
(function () {
  const byId = (id) => document.getElementById(id);
  const meta = JSON.parse(byId('viewer-meta').textContent);

  function bytesOf(id) {
    const element = byId('data-' + id);
    const text = atob(element.textContent);
    element.remove();  // The text is much larger than the array.
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
    return bytes.buffer;
  }

  // ---- data ----
  const count = meta.points;
  const ids = new Float64Array(bytesOf('id'));
  const ownColor = new Uint8Array(bytesOf('color'));
  const clusterOf = new Int32Array(bytesOf('cluster'));  // Index into meta.clusters, or -1.
  const topClass = new Uint16Array(bytesOf('top-class'));
  const topShare = new Uint8Array(bytesOf('top-share'));
  const arms = meta.arms.map((arm, k) => {
    const position = new Float32Array(bytesOf('position-' + k));
    const present = new Uint8Array(count);
    for (let i = 0; i < count; ++i) {
      present[i] = Number.isNaN(position[3 * i]) ? 0 : 1;
      if (!present[i]) position.fill(0, 3 * i, 3 * i + 3);
    }
    return {
      info: arm, position, present,
      planeOf: new Int32Array(bytesOf('plane-' + k)),  // Index into meta.planes, or -1.
      cameras: new Float32Array(bytesOf('cameras-' + k)),
      path: new Float32Array(bytesOf('path-' + k)),
      trust: arm.trust ? new Uint8Array(bytesOf('trust-' + k)) : null,  // Index of meta.state_colors.
    };
  });
  const truth = new Float32Array(bytesOf('truth'));

  const state = {
    arm: arms.length - 1, color: meta.classes.length ? 'class' : 'own', size: 2,
    classes: meta.classes.map(() => true), clusters: meta.clusters.map(() => true),
    planes: meta.planes.map(() => true), unlabelled: true, onlyPlanes: false,
    showPoints: true, showCameras: true, showPlanes: true, showPath: true, showTruth: true,
    // Where all is good the colours would tell nothing.
    trustPath: arms.some((arm) => arm.trust && arm.trust.some((s) => s > 0)),
  };

  // ---- scene ----
  const holder = byId('viewer');
  const canvas = byId('view3d');
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({canvas, antialias: true, preserveDrawingBuffer: true});
  } catch (error) {
    byId('viewer-note').textContent = 'This browser cannot show the 3D view: it has no WebGL 2.';
    return;
  }
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  renderer.setClearColor(0x15181d, 1);
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(50, 1, meta.radius / 500, meta.radius * 100);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);

  const vertexHead = 'in float visible; uniform float size;\n' +
      'void place() { gl_PointSize = size;\n' +
      '  gl_Position = visible > 0.0 ? projectionMatrix * modelViewMatrix * vec4(position, 1.0)\n' +
      '                              : vec4(0.0, 0.0, 2.0, 1.0); }\n';
  const sizeUniform = {value: state.size};
  const pointMaterial = new THREE.ShaderMaterial({
    glslVersion: THREE.GLSL3, uniforms: {size: sizeUniform},
    vertexShader: vertexHead + 'in vec3 tint; out vec3 shade;\n' +
        'void main() { place(); shade = tint; }',
    fragmentShader: 'in vec3 shade; out vec4 result;\nvoid main() { result = vec4(shade, 1.0); }',
  });
  const pickMaterial = new THREE.ShaderMaterial({
    glslVersion: THREE.GLSL3, uniforms: {size: sizeUniform}, blending: THREE.NoBlending,
    vertexShader: vertexHead + 'out vec4 code;\nvoid main() { place(); int n = gl_VertexID + 1;\n' +
        '  code = vec4(ivec4(n & 255, (n >> 8) & 255, (n >> 16) & 255, (n >> 24) & 255)) / 255.0; }',
    fragmentShader: 'in vec4 code; out vec4 result;\nvoid main() { result = code; }',
  });
  const geometry = new THREE.BufferGeometry();
  const tint = new THREE.BufferAttribute(new Uint8Array(3 * count), 3, true);
  const visible = new THREE.BufferAttribute(new Uint8Array(count), 1, true);
  const positions = arms.map((arm) => new THREE.BufferAttribute(arm.position, 3));
  geometry.setAttribute('tint', tint);
  geometry.setAttribute('visible', visible);
  const points = new THREE.Points(geometry, pointMaterial);
  points.frustumCulled = false;
  scene.add(points);
  const pickScene = new THREE.Scene();
  const pickPoints = new THREE.Points(geometry, pickMaterial);
  pickPoints.frustumCulled = false;
  pickScene.add(pickPoints);

  const css = (color) => 'rgb(' + color.join(',') + ')';
  function lineOf(array, color) {
    const g = new THREE.BufferGeometry();
    g.setAttribute('position', new THREE.BufferAttribute(array, 3));
    return new THREE.Line(g, new THREE.LineBasicMaterial({color}));
  }
  function trustLineOf(arm) {
    const colors = meta.state_colors.map((color) => new THREE.Color(css(color)).toArray());
    const line = lineOf(arm.path, 0xffffff);
    const shades = Array.from(arm.trust, (s) => colors[s]).flat();
    line.geometry.setAttribute('color', new THREE.Float32BufferAttribute(shades, 3));
    line.material.vertexColors = true;
    return line;
  }
  function camerasOf(array) {  // Per camera: centre and four corners.
    const edges = [0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1];
    const index = [];
    for (let c = 0; c < array.length / 15; ++c) for (const e of edges) index.push(5 * c + e);
    const g = new THREE.BufferGeometry();
    g.setAttribute('position', new THREE.BufferAttribute(array, 3));
    g.setIndex(index);
    return new THREE.LineSegments(g, new THREE.LineBasicMaterial({color: 0x6ea8fe}));
  }
  function planeOfArm(plane, index) {
    const group = new THREE.Group();
    const color = new THREE.Color(css(plane.color));
    const corners = plane.outline;
    if (corners.length >= 3) {
      const g = new THREE.BufferGeometry();
      g.setAttribute('position', new THREE.Float32BufferAttribute(corners.flat(), 3));
      const fan = [];
      for (let i = 2; i < corners.length; ++i) fan.push(0, i - 1, i);
      g.setIndex(fan);
      const mesh = new THREE.Mesh(g, new THREE.MeshBasicMaterial(
          {color, transparent: true, opacity: 0.28, side: THREE.DoubleSide, depthWrite: false}));
      mesh.userData = plane;
      group.add(mesh);
      const rim = corners.concat([corners[0]]).flat();
      group.add(lineOf(new Float32Array(rim), color));
    }
    const c = plane.centroid, n = plane.normal, l = meta.radius * 0.08;
    group.add(lineOf(new Float32Array(
        [c[0], c[1], c[2], c[0] + l * n[0], c[1] + l * n[1], c[2] + l * n[2]]), color));
    group.userData.index = index;
    return group;
  }
  for (const arm of arms) {
    arm.cameraLines = camerasOf(arm.cameras);
    arm.pathLine = lineOf(arm.path, 0xffb347);
    if (arm.trust) arm.trustLine = trustLineOf(arm);
    arm.planeGroup = new THREE.Group();
    for (const plane of arm.info.planes) arm.planeGroup.add(planeOfArm(plane, plane.index));
    scene.add(arm.cameraLines, arm.pathLine, arm.planeGroup);
    if (arm.trustLine) scene.add(arm.trustLine);
  }
  const truthLine = lineOf(truth, 0xffffff);
  scene.add(truthLine);

  // ---- what is shown ----
  const classOfPoint = (i) => clusterOf[i] >= 0 ? meta.clusters[clusterOf[i]].class : -1;
  const planeOf = (i) => arms[state.arm].planeOf[i];
  function shown(i) {
    if (state.onlyPlanes && planeOf(i) < 0) return false;
    if (clusterOf[i] < 0) return state.unlabelled;
    if (!state.clusters[clusterOf[i]] || !state.classes[classOfPoint(i)]) return false;
    return planeOf(i) < 0 || state.planes[planeOf(i)];
  }
  function distinct(n) {  // A hue per number, far from its neighbours' hues.
    const c = new THREE.Color().setHSL((n * 0.61803398875) % 1, 0.65, 0.6, 'srgb');
    const hex = c.getHex('srgb');
    return [hex >> 16, (hex >> 8) & 255, hex & 255];
  }
  const clusterColors = meta.clusters.map((c) => distinct(c.id));
  const planeColors = meta.planes.map((p) => distinct(p.id));
  const grey = [110, 110, 110];
  function colorOf(i) {
    if (state.color === 'class') return clusterOf[i] < 0 ? grey : meta.classes[classOfPoint(i)].color;
    if (state.color === 'cluster') return clusterOf[i] < 0 ? grey : clusterColors[clusterOf[i]];
    return planeOf(i) < 0 ? grey : planeColors[planeOf(i)];
  }
  function updateColors() {
    if (state.color === 'own') {
      tint.array.set(ownColor);
    } else {
      for (let i = 0; i < count; ++i) tint.array.set(colorOf(i), 3 * i);
    }
    tint.needsUpdate = true;
  }
  let visibleCount = 0;
  function updateVisible() {
    const present = arms[state.arm].present;
    visibleCount = 0;
    for (let i = 0; i < count; ++i) {
      const on = present[i] && shown(i) ? 255 : 0;
      visible.array[i] = on;
      visibleCount += on ? 1 : 0;
    }
    visible.needsUpdate = true;
    byId('visible-count').textContent = visibleCount + ' of ' + count + ' points';
    for (const [k, arm] of arms.entries()) {
      const current = k === state.arm;
      arm.cameraLines.visible = current && state.showCameras;
      const byTrust = state.trustPath && arm.trustLine;
      arm.pathLine.visible = current && state.showPath && !byTrust;
      if (arm.trustLine) arm.trustLine.visible = current && state.showPath && state.trustPath;
      arm.planeGroup.visible = current && state.showPlanes;
      for (const group of arm.planeGroup.children) {
        const plane = meta.planes[group.userData.index];
        group.visible = state.planes[group.userData.index] && state.classes[plane.class] &&
            state.clusters[plane.cluster];
      }
    }
    points.visible = state.showPoints;
    truthLine.visible = state.showTruth;
  }
  function setArm(k) {
    state.arm = k;
    geometry.setAttribute('position', positions[k]);
    if (state.color === 'plane') updateColors();
    updateVisible();
    draw();
  }

  // ---- drawing, only when something has changed ----
  let waiting = false;
  function draw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      renderer.render(scene, camera);
    });
  }
  function resize() {
    const width = holder.clientWidth, height = holder.clientHeight;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    draw();
  }
  function look(direction) {
    const d = new THREE.Vector3(...direction).normalize().multiplyScalar(meta.radius * 2.6);
    controls.target.set(0, 0, 0);
    camera.position.copy(d);
    controls.update();
    draw();
  }
  controls.addEventListener('change', draw);
  window.addEventListener('resize', resize);

  // ---- what lies under the pointer ----
  const pickSize = 9;
  const pickTarget = new THREE.WebGLRenderTarget(pickSize, pickSize);
  const pickBytes = new Uint8Array(4 * pickSize * pickSize);
  function pointAt(x, y) {
    if (!state.showPoints) return -1;
    const half = (pickSize - 1) / 2;
    camera.setViewOffset(holder.clientWidth, holder.clientHeight, x - half, y - half, pickSize,
                         pickSize);
    renderer.setRenderTarget(pickTarget);
    renderer.setClearColor(0, 0);
    renderer.clear();
    renderer.render(pickScene, camera);
    renderer.readRenderTargetPixels(pickTarget, 0, 0, pickSize, pickSize, pickBytes);
    renderer.setRenderTarget(null);
    renderer.setClearColor(0x15181d, 1);
    camera.clearViewOffset();
    let best = -1, nearest = Infinity;
    for (let k = 0; k < pickSize * pickSize; ++k) {
      const b = 4 * k;
      const code = pickBytes[b] + 256 * pickBytes[b + 1] + 65536 * pickBytes[b + 2] +
          16777216 * pickBytes[b + 3];
      const dx = k % pickSize - half, dy = Math.floor(k / pickSize) - half;
      if (code > 0 && code <= count && dx * dx + dy * dy < nearest) {
        nearest = dx * dx + dy * dy;
        best = code - 1;
      }
    }
    return best;
  }
  const raycaster = new THREE.Raycaster();
  function planeAt(x, y) {
    const arm = arms[state.arm];
    if (!state.showPlanes) return null;
    raycaster.setFromCamera(new THREE.Vector2(2 * x / holder.clientWidth - 1,
                                              1 - 2 * y / holder.clientHeight), camera);
    const meshes = arm.planeGroup.children.filter((g) => g.visible)
        .flatMap((g) => g.children.filter((m) => m.isMesh));
    const hits = raycaster.intersectObjects(meshes, false);
    return hits.length ? hits[0].object.userData : null;
  }
  const vector = (v) => '(' + v.map((x) => x.toPrecision(4)).join(', ') + ')';
  function describePlane(plane) {
    const entry = meta.planes[plane.index];
    return ['plane ' + entry.id + ': ' + meta.classes[entry.class].name + ', object ' +
                meta.clusters[entry.cluster].id,
            plane.points + ' points', 'normal in the model ' + vector(plane.normal_in_world),
            'points off it, RMS ' + plane.rms.toPrecision(3) +
                (plane.rms_sigma > 0 ? ' (' + plane.rms_sigma.toPrecision(3) + ' sigma)' : '')];
  }
  function describePoint(i) {
    const p = arms[state.arm].position.subarray(3 * i, 3 * i + 3);
    const lines = ['point ' + ids[i] + ' at ' + vector(Array.from(p))];
    for (let k = 0; k < 3; ++k) {
      const percent = Math.round(topShare[3 * i + k] / 2.55);
      if (percent === 0) continue;
      lines.push(percent + ' % ' +
                 meta.classes[topClass[3 * i + k]].name);
    }
    if (clusterOf[i] >= 0) {
      const cluster = meta.clusters[clusterOf[i]];
      lines.push('object ' + cluster.id + ': ' + meta.classes[cluster.class].name + ', ' +
                 cluster.points + ' points');
    } else {
      lines.push('in no object');
    }
    const plane = arms[state.arm].info.planes.find((q) => q.index === planeOf(i));
    return plane ? lines.concat(describePlane(plane)) : lines;
  }
  const tip = byId('tip');
  function hover(x, y) {
    const i = pointAt(x, y);
    const plane = i < 0 ? planeAt(x, y) : null;
    const lines = i >= 0 ? describePoint(i) : plane ? describePlane(plane) : [];
    tip.hidden = lines.length === 0;
    tip.replaceChildren(...lines.map((line) => {
      const div = document.createElement('div');
      div.textContent = line;
      return div;
    }));
    tip.style.left = Math.min(x + 14, holder.clientWidth - tip.offsetWidth - 4) + 'px';
    tip.style.top = Math.min(y + 14, holder.clientHeight - tip.offsetHeight - 4) + 'px';
  }
  let pending = null;
  canvas.addEventListener('pointermove', (event) => {
    if (event.buttons) {
      tip.hidden = true;
      return;
    }
    if (!pending) requestAnimationFrame(() => { const p = pending; pending = null; hover(...p); });
    pending = [event.offsetX, event.offsetY];
  });
  canvas.addEventListener('pointerleave', () => { tip.hidden = true; });

  // ---- controls ----
  function refresh() { updateVisible(); draw(); }
  function bindCheck(id, key) {
    const box = byId(id);
    if (!box) return;  // There is nothing of that kind.
    box.checked = state[key];
    box.addEventListener('change', () => {
      state[key] = box.checked;
      refresh();
    });
  }
  for (const key of ['showPoints', 'showCameras', 'showPlanes', 'showPath', 'trustPath',
                     'showTruth', 'unlabelled', 'onlyPlanes']) {
    bindCheck(key, key);
  }
  function choice(holderId, name, texts, initial, onChange) {
    texts.forEach((text, k) => {
      const label = document.createElement('label');
      const input = document.createElement('input');
      input.type = 'radio';
      input.name = name;
      input.id = name + '-' + k;
      input.checked = k === initial;
      input.addEventListener('change', () => onChange(k));
      label.append(input, ' ' + text);
      byId(holderId).append(label);
    });
  }
  choice('arms', 'arm', meta.arms.map((a) => a.title), state.arm, setArm);
  const colorings = meta.classes.length ? ['own', 'class', 'cluster', 'plane'] : ['own'];
  choice('colors', 'color', colorings.map((c) => c === 'own' ? 'image' : c === 'cluster' ? 'object' : c),
         colorings.indexOf(state.color), (k) => {
    state.color = colorings[k];
    updateColors();
    draw();
  });
  function checkList(id, flags, entries) {  // entries: {text, color}
    const boxes = entries.map((entry, k) => {
      const label = document.createElement('label');
      const input = document.createElement('input');
      input.type = 'checkbox';
      input.id = id + '-' + k;
      input.checked = true;
      input.addEventListener('change', () => { flags[k] = input.checked; refresh(); });
      const swatch = document.createElement('span');
      swatch.className = 'swatch';
      swatch.style.background = css(entry.color);
      label.append(input, swatch, entry.text);
      label.hidden = entry.hidden === true;
      byId(id).append(label);
      return input;
    });
    for (const on of [true, false]) {
      byId(id + (on ? '-all' : '-none')).addEventListener('click', () => {
        flags.fill(on);
        for (const box of boxes) box.checked = on;
        refresh();
      });
    }
  }
  checkList('classes', state.classes, meta.classes.map((c) => (
      {text: c.name + ' (' + c.points + ')', color: c.color, hidden: c.points === 0})));
  checkList('clusters', state.clusters, meta.clusters.map((c, k) => (
      {text: c.id + ' ' + meta.classes[c.class].name + ' (' + c.points + ')',
       color: clusterColors[k]})));
  checkList('planes', state.planes, meta.planes.map((p, k) => (
      {text: p.id + ' ' + meta.classes[p.class].name + ' (' + p.points + ')',
       color: planeColors[k]})));
  byId('point-size').addEventListener('input', (event) => {
    sizeUniform.value = Number(event.target.value) * renderer.getPixelRatio();
    draw();
  });
  sizeUniform.value = state.size * renderer.getPixelRatio();
  byId('look-top').addEventListener('click', () => look([0, -0.001, 1]));
  byId('look-oblique').addEventListener('click', () => look([1, -1, 0.9]));
  byId('look-side').addEventListener('click', () => look([0, -1, 0]));

  updateColors();
  setArm(state.arm);
  resize();
  look([1, -1, 0.9]);
  // For tests and for the curious at the console.
  window.s3lamViewer = {
    state, renderer, hover,
    visiblePoints: () => visibleCount,
    screenOf: (i) => {
      const p = new THREE.Vector3().fromArray(arms[state.arm].position, 3 * i).project(camera);
      return [(p.x + 1) / 2 * holder.clientWidth, (1 - p.y) / 2 * holder.clientHeight];
    },
  };
  byId('viewer-note').textContent = '';
})();
