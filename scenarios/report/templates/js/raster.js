// Grey images as canvases in the colours of the theme: 255 a wall, 128 free, 0 unknown; or a field of shades.
const RasterLayer = L.ImageOverlay.extend({
  initialize(raster, paint, options) {
    this._raster = raster;
    this._paint = paint;
    const [x0, y0, x1, y1] = raster.corners;
    L.ImageOverlay.prototype.initialize.call(this, "", [[y0, x0], [y1, x1]], options);
  },
  _initImage() {
    this._url = make("canvas", { "aria-hidden": "true" });
    L.SVGOverlay.prototype._initImage.call(this);
    const image = new Image();
    image.onload = () => { this._grey = greyOf(image); this.repaint(); };
    image.src = this._raster.image;
  },
  repaint() {
    if (!this._grey || !this._image) return;
    const canvas = this._image, { values, width, height } = this._grey;
    [canvas.width, canvas.height] = [width, height];
    const pixels = new ImageData(width, height), shade = this._paint();
    for (let i = 0; i < values.length; i++) if (values[i]) pixels.data.set(shade(values[i]), 4 * i);
    canvas.getContext("2d").putImageData(pixels, 0, 0);
  },
});

function greyOf(image) {
  const context = make("canvas", { width: image.width, height: image.height }).getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  const { data, width, height } = context.getImageData(0, 0, image.width, image.height);
  return { values: Uint8Array.from({ length: width * height }, (_, i) => data[4 * i]), width, height };
}

const pot = make("canvas", { width: 1, height: 1 }).getContext("2d", { willReadFrequently: true });

function rgb(name) {
  pot.fillStyle = colour(name);
  pot.fillRect(0, 0, 1, 1);
  return [...pot.getImageData(0, 0, 1, 1).data.slice(0, 3)];
}

// Walls in one colour over lightly shaded free space.
function mapPaint(wall) {
  return () => {
    const onWall = [...rgb(wall), 235], onFree = [...rgb(wall), 20];
    return (grey) => (grey === 255 ? onWall : onFree);
  };
}

function fieldPaint(name) {
  return () => {
    const full = rgb(name);
    return (grey) => [...full, 0.6 * grey];
  };
}
