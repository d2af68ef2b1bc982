// Points of one size in pixels: one vertex each, where deck.PointCloudLayer takes three and lights
// them. Without a graphics card this is the difference between a slide show and a film.
"use strict";
class DotLayer extends deck.Layer {
  getShaders() {
    const uniforms = {
      name: "dots", vs: "layout(std140) uniform dotsUniforms { float size; } dots;",
      uniformTypes: {size: "f32"},
    };
    const vs = `#version 300 es
      in vec3 positions;
      in vec4 colors;
      out vec4 color;
      void main() {
        gl_Position = project_position_to_clipspace(positions, vec3(0.0), vec3(0.0));
        gl_PointSize = dots.size * project.devicePixelRatio;
        color = colors;
      }`;
    const fs = `#version 300 es
      precision highp float;
      in vec4 color;
      out vec4 fragColor;
      void main() { fragColor = color; }`;
    return super.getShaders({vs, fs, modules: [deck.project32, uniforms]});
  }

  initializeState() {
    const attributes = this.getAttributeManager();
    attributes.add({
      positions: {size: 3, accessor: "getPosition"},
      colors: {size: 4, type: "unorm8", accessor: "getColor"},
    });
    this.state.model = new luma.Model(this.context.device, {
      ...this.getShaders(), id: this.props.id, topology: "point-list", isInstanced: false,
      bufferLayout: attributes.getBufferLayouts(),
    });
  }

  draw() {
    const {model} = this.state;
    model.setVertexCount(this.getNumInstances());
    model.shaderInputs.setProps({dots: {size: this.props.size}});
    model.draw(this.context.renderPass);
  }
}
DotLayer.layerName = "DotLayer";
DotLayer.defaultProps = {
  size: 2, getPosition: {type: "accessor", value: (d) => d.position},
  getColor: {type: "accessor", value: [255, 255, 255, 255]},
};
